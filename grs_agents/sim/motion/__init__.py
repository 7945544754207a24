"""What the robot does: grasps, pick and place, pushes, and where things can be put down."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
