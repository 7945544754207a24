"""Shared geometry: rotations and poses, convex hulls, polygons as pixels."""
