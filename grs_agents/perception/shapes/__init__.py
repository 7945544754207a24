"""Shapes of objects that no asset matches: a closed, textured mesh of what the photo shows, and its colliders."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
