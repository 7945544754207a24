"""What the robot does: grasps, pick and place, pushes, and where things can be put down."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
