"""Whether people can see what a task adds to the photo: not covered, and of another colour than what it lies on."""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Final

import numpy as np

from grs_agents.audit.goal_checks import asset_with_id, is_movable_object, pair_instances_with_rollouts
from grs_agents.audit.types import Finding
from grs_agents.base import Pose
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.footprints import Prism, find_prisms_at_pose, margins_inside_outline
from grs_agents.sim.world.spec import load_object_model

SEEN: Final = 0.4
"""Share of a thing's area, seen from above, that nothing may cover both at the start and at the end."""
CONTRAST: Final = 0.05
"""Distance of two colours (red, green, blue in 0..1) from which on a mark stands out from what it lies on."""
_POINTS: Final = 15
"""Rows and columns of the points of a thing that are looked at."""
_SAME_HEIGHT: Final = 0.0003
"""Of two surfaces less than this (m) apart, which one is seen changes from pixel to pixel."""


def check_visibility(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], library: Library, scene: SceneDescription | None
) -> Finding:
    """The finding ``seen``, of what the photo does not show."""
    shown = {item.asset for item in scene.objects} if scene is not None else set[str]()
    faults = [
        fault
        for instance, rollout in pair_instances_with_rollouts(instances, rollouts)
        for fault in _describe_hidden_marks(instance, rollout, library, shown)
    ]
    bound = f"of what the task adds, {SEEN:.0%} must be seen from above at the start or at the end, and marks must be "
    bound += "of another colour than what they lie on"
    return Finding.from_fault_list("seen", faults, "what the task adds can be seen", bound)


def _describe_hidden_marks(
    instance: TaskInstance, rollout: Rollout, library: Library, shown: Set[str]
) -> Iterator[str]:
    known = [item for item in instance.objects if item.asset in library]
    moments = [_prisms_by_object_id(known, poses, library) for poses in (rollout.initial, rollout.final) if poses]
    for item in _list_added_fixed_objects(known, library) if moments else ():
        others = _list_ids_that_may_not_cover(item, known, shown)
        share = max(_visible_area_share(item.id, others, surfaces) for surfaces in moments)
        if share < SEEN:
            yield f"{asset_with_id(instance, item.id)} is covered: {share:.0%} of it can be seen"
        elif _has_color_of_ground_below(item, known, instance, moments[0], library):
            yield f"{asset_with_id(instance, item.id)} has the colour of what it lies on"


def _list_ids_that_may_not_cover(item: InstanceObject, known: Sequence[InstanceObject], shown: Set[str]) -> list[int]:
    """Ids of what may not cover an object: what the photo shows may be covered by what it shows, too."""
    return [one.id for one in known if one.id != item.id and not {one.asset, item.asset} <= shown]


def _list_added_fixed_objects(known: Sequence[InstanceObject], library: Library) -> list[InstanceObject]:
    """What a task adds and nothing moves."""
    return [item for item in known if item.role == "task" and not is_movable_object(item, library)]


def _prisms_by_object_id(
    items: Sequence[InstanceObject], poses: Mapping[int, Pose], library: Library
) -> dict[int, list[Prism]]:
    """The parts of each object, by its id; a mark is one flat part."""
    surfaces: dict[int, list[Prism]] = {}
    for item in items:
        model = load_object_model(item, library)
        parts, whole = find_prisms_at_pose(model, poses.get(item.id, item.pose), item.id)
        surfaces[item.id] = parts or [whole]
    return surfaces


def _visible_area_share(number: int, others: Sequence[int], surfaces: Mapping[int, Sequence[Prism]]) -> float:
    """The share (0..1) of an object's area that no other one lies over."""
    points, heights = _sample_top_points_and_heights(surfaces[number])
    if not len(points):
        return 1.0
    free = np.ones(len(points), dtype=bool)
    for prism in (prism for other in others for prism in surfaces[other] if len(prism.outline) >= 3):
        over = prism.high > heights - _SAME_HEIGHT
        free &= ~(over & (margins_inside_outline(np.zeros((1, 2)), prism.outline, points) >= 0))
    return float(free.mean())


def _sample_top_points_and_heights(prisms: Sequence[Prism]) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) spread over an object as seen from above, and how high (N,) it is there, metres."""
    solid = [prism for prism in prisms if len(prism.outline) >= 3]
    if not solid:
        return np.zeros((0, 2)), np.zeros(0)
    corners = np.vstack([prism.outline for prism in solid])
    low, high = corners.min(axis=0), corners.max(axis=0)
    steps = (np.arange(_POINTS) + 0.5) / _POINTS
    grid = np.stack(np.meshgrid(*(low + np.outer(steps, high - low)).T), axis=-1).reshape(-1, 2)
    heights = np.full(len(grid), -np.inf)
    for prism in solid:
        inside = margins_inside_outline(np.zeros((1, 2)), prism.outline, grid) >= 0
        heights = np.where(inside, np.maximum(heights, prism.high), heights)
    return grid[np.isfinite(heights)], heights[np.isfinite(heights)]


def _has_color_of_ground_below(
    item: InstanceObject,
    known: Sequence[InstanceObject],
    instance: TaskInstance,
    surfaces: Mapping[int, Sequence[Prism]],
    library: Library,
) -> bool:
    """Whether a mark cannot be told from the table, or from the highest mark that all of it lies on."""
    own = _single_color_of_mark(item, library)
    if own is None:
        return False
    [prism] = surfaces[item.id]
    below, height = instance.table.color, -math.inf
    for other in known:
        color = _single_color_of_mark(other, library)
        if other.id == item.id or color is None:
            continue
        [ground] = surfaces[other.id]
        whole = margins_inside_outline(prism.outline, ground.outline, np.zeros((1, 2)))[0] >= 0
        if whole and height < ground.high <= prism.high:
            below, height = color, ground.high
    return math.dist(own[:3], below[:3]) < CONTRAST


def _single_color_of_mark(item: InstanceObject, library: Library) -> tuple[float, ...] | None:
    """The one colour of a mark; None for what touches things, or is of several colours."""
    model = load_object_model(item, library)
    colors = {shape.color for shape in model.visuals}
    return None if model.colliders or len(colors) != 1 else item.color or next(iter(colors))
