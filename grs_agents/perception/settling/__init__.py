"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
