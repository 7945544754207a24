"""Rendering of simulated scenes: colour, depth and object ids, by ray casting or OpenGL."""
