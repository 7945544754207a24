"""What the two sides of the sandbox say to each other: orders, settings, reports, tracebacks."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
