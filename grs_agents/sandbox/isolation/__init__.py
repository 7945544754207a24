"""What confines a worker: command lines of the backends, Landlock, seccomp, limits."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
