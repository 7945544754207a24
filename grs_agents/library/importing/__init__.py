"""Bringing 3D models of others into a library: read with care, checked, mended, weighed and written in one form."""
