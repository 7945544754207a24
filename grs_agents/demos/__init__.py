"""Demonstrations: the expert's episodes at a control rate, replayed, as data sets of LeRobot, robomimic and Minari."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
