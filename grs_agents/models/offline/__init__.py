"""The embedded chat model that answers GRS's prompts by rules."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
