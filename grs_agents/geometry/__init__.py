"""Rotations and poses, convex hulls, polygons as pixels: plain geometry that several rooms share."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
