"""Left, right, behind and in front are the robot's; if the photo shows other sides, the words must say so."""

import math
import re
from typing import Final

import numpy as np

from grs_agents.perception.types import TableFrame

_ASIDE: Final = re.compile(
    r"\b(?:(?:the|its|their) (?P<a>left|right)\b(?! (?:over|where|alone)\b)"
    r"|(?P<b>left|right)[ -](?:of|hand|side|end|edge|half|part|to (?:right|left))\b"
    r"|(?P<c>leftmost|rightmost)\b|(?:(?<=the front )|(?<=the back )|(?<=the rear ))(?P<d>left|right)\b)",
    re.IGNORECASE,
)
_AHEAD: Final = re.compile(
    r"\b(?:(?P<a>behind|in front of)\b|(?:in|at|to|on) the (?P<b>front|back|rear)\b(?! of (?:the|its) label\b)"
    r"|(?P<c>front|back|rear) (?:row|side|end|edge|half|part|left|right)\b)",
    re.IGNORECASE,
)
_OWNED: Final = re.compile(
    r"\bas the robot sees\b|\bseen (?:by|from) the robot\b|\bfrom the robot's\b|\bthe robot's (?:left|right)\b",
    re.IGNORECASE,
)
_PHOTO: Final = re.compile(r"\b(?:in|of|on) the (?:photo|picture|image)\b", re.IGNORECASE)
_AS_IN_PHOTO: Final = re.compile(
    r",? ?\bas (?:seen |shown )?(?:in|on|from) the (?:photo|picture|image)(?: (?:shows|sees) (?:it|them))?\b",
    re.IGNORECASE,
)
_OPPOSITE: Final = {
    "left": "right",
    "leftmost": "rightmost",
    "behind": "in front of",
    "front": "back",
    "back": "front",
    "rear": "front",
} | {"right": "left", "rightmost": "leftmost", "in front of": "behind"}
_ALIKE: Final = math.cos(math.radians(45))
"""Cosine of 45 degrees, the angle half-way to the next side."""


def explain_ambiguous_sides(words: str, frame: TableFrame | None) -> str:
    """Explain why words of sides mean different sides to the robot and to a viewer of the photo; empty if they do not.

    Args:
        words: the task's text.
        frame: the photo's, whose camera also draws the films; None without a photo.
    """
    if frame is None or (_OWNED.search(words) and not _PHOTO.search(words)):
        return ""
    right, away = _photo_axes(frame)
    for form, seen, robot_side in ((_ASIDE, -right, (0.0, 1.0)), (_AHEAD, away, (1.0, 0.0))):
        side = form.search(words)
        if side is not None and np.dot(seen, robot_side) < _ALIKE:
            word = next(filter(None, side.groups()))
            return f"{word!r} is another side for the robot than in the photo"
    return ""


def state_robot_sides(words: str, frame: TableFrame | None) -> str:
    """The words with sides "as in the photo" turned into the robot's; unchanged if they do not say so, or if the camera
    stands aside, where left in the photo is neither left nor right of the robot.

    Args:
        words: the task's text.
        frame: the photo's; None without a photo.
    """
    if frame is None or not _AS_IN_PHOTO.search(words) or _OWNED.search(words):
        return words
    right, away = _photo_axes(frame)
    alike = float(np.dot(-right, (0.0, 1.0))), float(np.dot(away, (1.0, 0.0)))
    if min(map(abs, alike)) < _ALIKE:
        return words
    for form, cosine in ((_ASIDE, alike[0]), (_AHEAD, alike[1])):
        if cosine < 0:
            words = form.sub(_swap_side, words)
    return _AS_IN_PHOTO.sub(", as the robot sees it", words)


def _swap_side(side: re.Match[str]) -> str:
    """The phrase of a side with the opposite side; of both in ``left to right``."""
    word = next(filter(None, side.groups())).lower()
    both = rf"\b(?:{word}|{_OPPOSITE[word]})\b"
    return re.sub(both, lambda each: _OPPOSITE[each.group().lower()], side.group(), flags=re.IGNORECASE)


def describe_sides_in_photo(frame: TableFrame | None) -> str:
    """A sentence that says in which direction of the photo each side of the robot lies; empty without a photo."""
    if frame is None:
        return ""
    right, away = _photo_axes(frame)
    shown: list[str] = []
    for axis, name in ((np.array((0.0, 1.0)), "its left"), (np.array((1.0, 0.0)), "away from it")):
        across, up = float(np.dot(axis, right)), float(np.dot(axis, away))
        if abs(across) >= abs(up):
            shown.append(f"{name} is {'right' if across > 0 else 'left'}")
        else:
            shown.append(f"{name} is {'up, into the distance' if up > 0 else 'down, towards the viewer'}")
    return f"Sides are as the robot sees them: in the photo, {' and '.join(shown)}."


def _photo_axes(frame: TableFrame) -> tuple[np.ndarray, np.ndarray]:
    """Directions (2,) along the table of the photo's right and of its upper edge, robot frame."""
    pose = np.array(frame.T_robot_cam)
    right, down, forward = pose[:2, 0], pose[:2, 1], pose[:2, 2]
    away = forward if np.linalg.norm(forward) > np.linalg.norm(down) else -down
    return right / np.linalg.norm(right), away / np.linalg.norm(away)
