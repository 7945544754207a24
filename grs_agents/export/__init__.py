"""A task instance for other programs: a folder with an MJCF file that opens in plain MuJoCo."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
