"""Objects that no asset fits: shapes made from what the camera saw, in free space."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
