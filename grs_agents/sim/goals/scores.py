"""Thresholds: when a goal counts as met, an episode as solved, and a bystander as moved."""

from typing import Final

MET: Final = 0.985
"""Score from which a goal, or an object of it, counts as met. Only shares of volume in zones lie between 0 and 1; a
volume is sampled by about 600 points (``sim.world.collision_volumes``), and the margin of 1.5 %, nine of them, absorbs
samples at the border of a zone."""
SOLVED: Final = 0.99
"""Strict score and published reward from which an episode counts as solved: the default of ``audit.reward``, by which
the audit accepts a task. CLIPort ends an episode where the sum of rewards passes 0.99. Met objects score 1 in the
strict score, so it needs no margin for samples."""
DISTURBED: Final = 0.01
"""Distance (m) that a bystander may move."""
