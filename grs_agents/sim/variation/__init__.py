"""Variations of a task: the same instance with its things elsewhere, heavier, in another light, among others."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
