"""What several views share: events as text, steps, motion, the objects of a run."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
