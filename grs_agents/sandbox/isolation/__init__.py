"""Confinement of a worker: command lines of the backends, Landlock, seccomp, limits."""
