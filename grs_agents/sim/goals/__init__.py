"""Whether goals hold: relations between objects, the published score and the strict one."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
