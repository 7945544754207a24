"""What the two sides of the sandbox say to each other: orders, settings, reports, tracebacks."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
