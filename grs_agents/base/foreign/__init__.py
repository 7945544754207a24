"""Reads what somebody else may have written: files, JSON, run folders, arrays and pictures, all within bounds.
Arrays and pictures need NumPy and OpenCV; import them from ``grs_agents.base.foreign.arrays`` and
``grs_agents.base.foreign.pictures``."""
