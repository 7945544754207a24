"""What confines a worker: command lines of the backends, Landlock, seccomp, limits."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
