"""Walls of a bin around the objects, found in the photo."""
