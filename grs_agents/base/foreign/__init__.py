"""Bounded readers of untrusted files: JSON, run folders, arrays and pictures. Arrays and pictures need NumPy and
OpenCV; import them from ``grs_agents.base.foreign.arrays`` and ``grs_agents.base.foreign.pictures``."""
