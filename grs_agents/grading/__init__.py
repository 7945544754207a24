"""How hard a task is: figures of its scene, its expert, and of policies that do not know what the expert knows."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
