"""What makes a result trustworthy: checks on task instances, measured by trusted code."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
