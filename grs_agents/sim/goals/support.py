"""What rests on what, and whether it lies still: shared by the scores and by the oracle."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.goals.scene_view import SceneView
from grs_agents.sim.world.footprints import Prism, convex_hull, gaps, inside_margin, near, overlap

FloatArray = npt.NDArray[np.float64]
_TOUCHING: Final = 0.006
_FOOTING: Final = 0.002
"""How far within what carries it a centre of mass must lie, metres."""
_OVERLAP: Final = -0.0005
_STILL: Final = 0.05
_GRAIN: Final = 0.02
"""What is no larger than this lies as it falls: any of its sides will do, metres."""
_POINT: Final = np.zeros((1, 2))


def supporters(number: int, view: SceneView) -> set[int]:
    """Ids of the objects whose top an object's underside rests on; empty on the bare table."""
    own = [prism for prism in view.prisms if prism.owner == number]
    low = min((prism.low for prism in own), default=0.0)
    feet = [prism for prism in own if prism.low < low + _TOUCHING]
    return {prism.owner for prism in view.others(number) if _carries(prism, feet)}


def around(number: int, view: SceneView) -> set[int]:
    """Ids of what an object on the table stands in, without a top of theirs under it: fixtures, rings."""
    own = view.outline(number)
    return {
        other
        for other in view.ids
        if own.low < _TOUCHING and other != number and view.model(other).colliders
        and view.outline(other).low < own.high and view.outline(other).high > own.low
        and view.over(other, view.pose(number)[0])
    }  # fmt: skip


def marks_under(number: int, view: SceneView) -> set[int]:
    """Ids of the marks on the table on which an object stands; empty if it is not on the table."""
    if view.outline(number).low > _TOUCHING:
        return set()
    return {
        other
        for other in view.ids
        if not view.model(other).colliders and abs(view.outline(other).high) < _TOUCHING
        and view.over(other, view.pose(number)[0])
    }  # fmt: skip


def _carries(prism: Prism, feet: Iterable[Prism]) -> bool:
    return any(
        abs(foot.low - prism.high) < _TOUCHING and gaps(foot.outline, prism.outline, _POINT)[0] < _OVERLAP
        for foot in feet
    )


def steady(parts: Sequence[Prism], height: float, center: FloatArray, others: Iterable[Prism]) -> bool:
    """Whether a body with its underside at a height (m) has its centre of mass (2,) over what would carry it."""
    if height < _TOUCHING:
        return True
    low = min(part.low for part in parts)
    feet = [part for part in parts if part.low < low + _TOUCHING]
    carriers = [prism for prism in others if abs(prism.high - height) < _TOUCHING]
    touching = [overlap(foot.outline, top.outline) for foot in feet for top in near(foot, carriers, (0.0, 0.0), 0.0)]
    base = convex_hull(np.vstack([np.zeros((0, 2)), *touching]))
    return len(base) > 2 and bool(inside_margin(_POINT, base, center[None])[0] > _FOOTING)


def toppled(number: int, view: SceneView, tolerance: float) -> bool:
    """Whether an object is more tilted than at the start, by more than ``tolerance`` radians; no ball or grain is."""
    model = view.model(number)
    if all(shape.kind == "sphere" for shape in model.colliders) or max(model.size) <= _GRAIN:
        return False
    return view.tilt(number) > view.tilt_at_start(number) + tolerance


def rests(number: int, view: SceneView) -> bool:
    """Whether an object lies still, let go by the robot."""
    return view.physics.held != number and view.physics.speed_of(number) < _STILL
