"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
