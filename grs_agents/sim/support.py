"""What rests on what, and whether it lies still: shared by the scores and by the oracle."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from grs_agents.sim.geometry import Prism, gaps
from grs_agents.sim.scene_view import SceneView

_TOUCHING: Final = 0.006
_OVERLAP: Final = -0.0005
_STILL: Final = 0.05
_POINT: Final = np.zeros((1, 2))


def supporters(number: int, view: SceneView) -> set[int]:
    """Ids of the objects whose top an object's underside rests on; empty on the bare table."""
    own = [prism for prism in view.prisms if prism.owner == number]
    low = min((prism.low for prism in own), default=0.0)
    feet = [prism for prism in own if prism.low < low + _TOUCHING]
    return {prism.owner for prism in view.others(number) if _carries(prism, feet)}


def _carries(prism: Prism, feet: Iterable[Prism]) -> bool:
    return any(
        abs(foot.low - prism.high) < _TOUCHING and gaps(foot.outline, prism.outline, _POINT)[0] < _OVERLAP
        for foot in feet
    )


def toppled(number: int, view: SceneView, tolerance: float) -> bool:
    """Whether an object is more tilted than at the start, by more than ``tolerance`` radians; balls never are."""
    if all(shape.kind == "sphere" for shape in view.model(number).colliders):
        return False
    return view.tilt(number) > view.tilt_at_start(number) + tolerance


def rests(number: int, view: SceneView) -> bool:
    """Whether an object lies still, let go by the robot."""
    return view.physics.held != number and view.physics.speed_of(number) < _STILL
