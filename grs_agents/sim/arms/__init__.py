"""The robots: kinematics, limits, tools, and the paths of their joints."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
