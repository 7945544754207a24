"""Many runs of many scenes: made side by side, told in one table, taken up again where they stopped."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
