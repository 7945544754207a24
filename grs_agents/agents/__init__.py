"""The agents: describer, matcher, task author, simulation author, test author, router and the two fixers."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
