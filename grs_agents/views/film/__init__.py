"""A film of a rollout, drawn by MuJoCo in a process of its own."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
