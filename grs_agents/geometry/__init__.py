"""Rotations and poses, convex hulls, polygons as pixels: plain geometry that several rooms share."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
