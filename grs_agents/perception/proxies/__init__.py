"""Objects that no asset fits: shapes made from what the camera saw, in free space."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
