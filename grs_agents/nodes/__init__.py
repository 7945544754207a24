"""The nodes of every graph: state in, update out."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
