"""Which asset stands for which object of a photo."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
