"""The scripted expert, which solves a task by what the simulation knows."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
