"""Pictures of simulated scenes: colour, depth and which object, by rays anywhere and by OpenGL where it works."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
