"""What confines a worker: command lines of the backends, Landlock, seccomp, limits."""
