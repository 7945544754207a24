"""Model files read with care: URDF and MJCF."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
