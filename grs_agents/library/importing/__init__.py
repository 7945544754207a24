"""Bringing 3D models of others into a library: read with care, checked, mended, weighed and written in one form."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
