"""Left, right, behind and in front are the robot's; if the photo shows other sides, the words must say so."""

import math
import re
from typing import Final

import numpy as np

from grs_agents.perception.types import TableFrame

_ASIDE: Final = re.compile(r"\b(left|leftmost|right|rightmost)\b(?! (?:next|beside|on|in|into|where)\b)", re.IGNORECASE)
_AHEAD: Final = re.compile(r"\b(behind|in front|front|back)\b", re.IGNORECASE)
_OWNED: Final = re.compile(
    r"\bas the robot sees\b|\bseen (?:by|from) the robot\b|\bfrom the robot's\b|\bthe robot's (?:left|right)\b",
    re.IGNORECASE,
)
_ALIKE: Final = math.cos(math.radians(45))
"""Cosine of 45 degrees, the angle half-way to the next side."""


def explain_ambiguous_sides(words: str, frame: TableFrame | None) -> str:
    """Explain why words of sides mean different sides to the robot and to a viewer of the photo; empty if they do not.

    Args:
        words: the task's text.
        frame: the photo's, whose camera also draws the films; None without a photo.
    """
    if frame is None or _OWNED.search(words):
        return ""
    pose = np.array(frame.T_robot_cam)
    right, down, forward = pose[:2, 0], pose[:2, 1], pose[:2, 2]
    away = forward if np.linalg.norm(forward) > np.linalg.norm(down) else -down
    for form, seen, robot_side in ((_ASIDE, -right, (0.0, 1.0)), (_AHEAD, away, (1.0, 0.0))):
        side = form.search(words)
        if side is not None and np.dot(seen, robot_side) < _ALIKE * np.linalg.norm(seen):
            return f"{side[0]!r} is another side for the robot than in the photo"
    return ""
