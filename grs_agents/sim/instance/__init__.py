"""A task as data: objects, goals, and how an episode with them ended."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
