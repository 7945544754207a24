"""Reads what somebody else may have written: files, JSON, run folders, arrays and pictures, all within bounds.

Arrays and pictures need NumPy and OpenCV; import them from ``grs_agents.foreign.arrays`` and
``grs_agents.foreign.pictures``.
"""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
