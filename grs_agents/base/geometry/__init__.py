"""Rotations and poses, convex hulls, polygons as pixels: plain geometry that several rooms share."""
