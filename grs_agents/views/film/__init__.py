"""A film of a rollout, drawn by MuJoCo in a process of its own."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
