"""Checks of the scenes themselves: as the photo shows them, apart at the start, at rest and undisturbed at the end."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from grs_agents.audit.goal_checks import asset_with_id, is_movable_object, pair_instances_with_rollouts
from grs_agents.audit.pose_changes import find_pose_changes, is_tilted
from grs_agents.audit.types import AuditFinding, join_first_distinct
from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.goals.scores import DISTURBED
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.footprints import Prism, find_prisms_at_pose, margins_inside_outline
from grs_agents.sim.world.spec import load_object_model

DEPTH: Final = 0.005
"""Most penetration (m) of two objects before the scene settles, within the depth noise of a photo."""
SHIFT: Final = 0.02
SINK: Final = 0.03
"""Most displacement (m) by settling: ``SHIFT`` sideways, ``SINK`` vertically."""
LEVEL: Final = 0.75
"""Share of an object's weight that must rest on contacts that are nearly level; honest tasks have 0.97 or more."""
SQUEEZE: Final = 0.75
"""Most sideways force over the weight: less than 0.3 in honest tasks, 1.1 to 6 for objects wedged in a bowl."""
OPAQUE, BURIED = 0.5, 0.0005
"""Objects of a task are at least so opaque, and marks no deeper (m) under the table top: people must see them."""
SEEN: Final = 0.4
"""Least share of an object's area that must be visible from above at the start or at the end."""
CONTRAST: Final = 0.05
"""Least distance of the colours (RGB in 0..1) of a mark and its ground."""
_POINTS: Final = 15
"""Rows and columns of the sample points of an object."""
_SAME_HEIGHT: Final = 0.0003
"""Difference in height (m) below which two surfaces flicker (z-fighting)."""
_ORIGIN: Final = np.zeros((1, 2))


def list_scene_findings(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], library: Library, scene: SceneDescription | None
) -> list[AuditFinding]:
    """Findings about the poses of objects, in all instances."""
    pairs = pair_instances_with_rollouts(instances, rollouts)
    findings = [
        check_objects_start_apart_and_stable(pairs),
        check_objects_rest_at_end(pairs),
        check_bystanders_undisturbed(pairs),
    ]
    return [check_photo_poses(instances, scene, library), *findings] if scene is not None else findings


def check_photo_poses(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> AuditFinding:
    """The finding ``photo_poses``: objects of the photo keep their poses and colours, unless there is a measured
    reason."""
    changes = find_pose_changes(instances, scene, library)
    moved = [change for change in changes if change.photo is not None and not change.reason]
    seeds: dict[str, list[int]] = {}
    for change in moved:
        text = f"{change.asset} is {(change.distance or 0.0) * 100:.0f} cm from its pose in the photo, "
        text += f"{_format_pose(change.wanted)}, and turned by {change.turned or 0.0:.0f} degrees"
        seeds.setdefault(text, []).append(change.seed)
    wrong = [
        f"{text} in seed{'s' if len(same) > 1 else ''} {', '.join(map(str, same))}" for text, same in seeds.items()
    ]
    wrong += [f"objects are tied in seed {instance.seed}" for instance in instances if instance.ties]
    painted = [item.asset for instance in instances for item in instance.task_objects if item.color is not None]
    shown = {item.asset for item in scene.objects}
    wrong += [f"{asset} is painted" for asset in painted if asset in shown]
    excused = [f"{change.asset} for it {change.reason}" for change in changes if change.reason]
    measured = join_first_distinct(wrong) or "everything that the photo shows stands as it shows it"
    if excused:
        measured += f"; moved with a reason: {join_first_distinct(excused)}"
    return AuditFinding(
        check="photo_poses",
        passed=not wrong,
        measured=measured,
        bound="objects must stand as the photo shows them, unless out of reach, covered or unstable there, and look so",
    )


def _format_pose(pose: Pose | None) -> str:
    """A pose as the prompts give it, in metres."""
    parts = [", ".join(f"{round(value, 3) + 0.0:g}" for value in part) for part in pose or ()]
    return f"({', '.join(f'({part})' for part in parts)})"


def check_objects_start_apart_and_stable(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> AuditFinding:
    """The finding ``clear_start``: no overlaps, nothing invisible, and no motion while the scene settles."""
    faults: list[str] = []
    for instance, rollout in pairs:
        bystanders = {item.id for item in instance.objects if item.role == "bystander"}
        excused = [{tie.parent, tie.child} for tie in instance.ties]
        for overlap in rollout.overlaps:
            pair = {overlap.first, overlap.second}
            # The photo, not the program, overlaps two bystanders; a program that moves them is at fault elsewhere.
            if overlap.depth > DEPTH and not pair <= bystanders and pair not in excused:
                names = f"{asset_with_id(instance, overlap.first)} and {asset_with_id(instance, overlap.second)}"
                faults.append(f"{names} reach {overlap.depth * 1000:.0f} mm into each other")
        for item in instance.task_objects:
            colors = (item.color or (), item.fill.get("COLOR", ()))
            transparent = any(len(color) > 3 and float(color[3]) < OPAQUE for color in colors)
            if transparent or (item.asset.startswith("zone/") and item.pose[0][2] < -BURIED):
                faults.append(f"{asset_with_id(instance, item.id)} cannot be seen")
        for item in (item for item in instance.objects if item.id in rollout.initial):
            start, rest = item.pose, rollout.initial[item.id]
            moved = math.dist(start[0][:2], rest[0][:2]) > SHIFT or abs(start[0][2] - rest[0][2]) > SINK
            if moved or is_tilted(start, rest):
                away = math.dist(start[0], rest[0])
                faults.append(f"settling moves {asset_with_id(instance, item.id)} by {away * 100:.1f} cm or tips it")
    bound = f"nothing may reach {DEPTH * 1000:.0f} mm into another thing, a bystander stand on a mark, or settling "
    bound += f"move anything {SHIFT * 100:.0f} cm sideways, {SINK * 100:.0f} cm up or down, or tip it"
    return AuditFinding.from_fault_list("clear_start", faults, "objects are apart, and stay where they are put", bound)


def check_objects_rest_at_end(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> AuditFinding:
    """The finding ``rests_at_end``: contact forces separate resting objects from hanging or wedged objects."""
    faults = [
        f"{asset_with_id(instance, support.object)} rests on level ground with {support.carried:.0%} of its weight, "
        f"sideways forces are {support.squeeze:.1f} times it"
        for instance, rollout in pairs
        for support in rollout.supports
        if any(support.object in goal.objects for goal in instance.goals)
        and (support.carried < LEVEL or support.squeeze > SQUEEZE)
    ]
    bound = f"level contacts must carry {LEVEL:.0%} of the weight of each object of a goal, and sideways forces be "
    bound += f"at most {SQUEEZE} times it"
    return AuditFinding.from_fault_list("rests_at_end", faults, "what was moved stands, and is not wedged", bound)


def check_bystanders_undisturbed(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> AuditFinding:
    """The finding ``undisturbed``."""
    ends = [
        (f"{item.asset} #{item.id}", rollout.initial[item.id], rollout.final[item.id])
        for instance, rollout in pairs
        for item in instance.objects
        if item.role == "bystander" and item.id in rollout.final
    ]
    moves = [(math.dist(start[0], end[0]), name) for name, start, end in ends]
    tipped = [f"{name} tipped over" for name, start, end in ends if is_tilted(start, end)]
    farthest, name = max(moves, default=(0.0, ""))
    measured = f"{name} moves by {farthest * 1000:.0f} mm" if moves else "there are no bystanders"
    return AuditFinding(
        check="undisturbed",
        passed=farthest <= DISTURBED and not tipped,
        measured=join_first_distinct([measured, *tipped]),
        bound=f"no bystander may move by more than {DISTURBED * 1000:.0f} mm or tilt by more than 15 degrees",
    )


def check_visibility(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], library: Library, scene: SceneDescription | None
) -> AuditFinding:
    """The finding ``seen``, about everything that the task adds to the photo."""
    shown = {item.asset for item in scene.objects} if scene is not None else set[str]()
    faults: list[str] = []
    for instance, rollout in pair_instances_with_rollouts(instances, rollouts):
        known = [item for item in instance.objects if item.asset in library]
        moments: list[dict[int, list[Prism]]] = []  # the parts of each object, by id, at the start and at the end
        for poses in (poses for poses in (rollout.initial, rollout.final) if poses):
            moments.append({})
            for item in known:
                model = load_object_model(item, library)
                parts, whole = find_prisms_at_pose(model, poses.get(item.id, item.pose), item.id)
                moments[-1][item.id] = parts or [whole]  # a mark is a single flat part
        for item in known if moments else ():
            if item.role != "task" or is_movable_object(item, library):
                continue
            others = [cover.id for cover in known if cover.id != item.id and not {cover.asset, item.asset} <= shown]
            share = max(_visible_area_share(item.id, others, surfaces) for surfaces in moments)
            if share < SEEN:
                faults.append(f"{asset_with_id(instance, item.id)} is covered: {share:.0%} of it can be seen")
            elif _has_color_of_ground_below(item, known, instance, moments[0], library):
                faults.append(f"{asset_with_id(instance, item.id)} has the colour of what it lies on")
    bound = f"of what the task adds, {SEEN:.0%} must be seen from above at the start or at the end, and marks must be "
    bound += "of another colour than what they lie on"
    return AuditFinding.from_fault_list("seen", faults, "what the task adds can be seen", bound)


def _visible_area_share(number: int, others: Sequence[int], surfaces: Mapping[int, Sequence[Prism]]) -> float:
    """Share (0..1) of an object's area from above that no other object covers, from a grid of sample points."""
    solid = [prism for prism in surfaces[number] if len(prism.outline) >= 3]
    if not solid:
        return 1.0
    corners = np.vstack([prism.outline for prism in solid])
    low, high = corners.min(axis=0), corners.max(axis=0)
    steps = (np.arange(_POINTS) + 0.5) / _POINTS
    grid = np.stack(np.meshgrid(*(low + np.outer(steps, high - low)).T), axis=-1).reshape(-1, 2)
    heights = np.full(len(grid), -np.inf)  # of the object's top at each point, m
    for prism in solid:
        inside = margins_inside_outline(_ORIGIN, prism.outline, grid) >= 0
        heights = np.where(inside, np.maximum(heights, prism.high), heights)
    points, heights = grid[np.isfinite(heights)], heights[np.isfinite(heights)]
    if not len(points):
        return 1.0
    free = np.ones(len(points), dtype=bool)
    for prism in (prism for neighbor in others for prism in surfaces[neighbor] if len(prism.outline) >= 3):
        over = prism.high > heights - _SAME_HEIGHT
        free &= ~(over & (margins_inside_outline(_ORIGIN, prism.outline, points) >= 0))
    return float(free.mean())


def _has_color_of_ground_below(
    item: InstanceObject,
    known: Sequence[InstanceObject],
    instance: TaskInstance,
    surfaces: Mapping[int, Sequence[Prism]],
    library: Library,
) -> bool:
    """True if a mark has the colour of the table, or of the highest mark that contains it."""
    mark_color = _single_color_of_mark(item, library)
    if mark_color is None:
        return False
    [prism] = surfaces[item.id]
    below, height = instance.table.color, -math.inf
    for mark in known:
        color = _single_color_of_mark(mark, library)
        if mark.id == item.id or color is None:
            continue
        [ground] = surfaces[mark.id]
        whole = margins_inside_outline(prism.outline, ground.outline, _ORIGIN)[0] >= 0
        if whole and height < ground.high <= prism.high:
            below, height = color, ground.high
    return math.dist(mark_color[:3], below[:3]) < CONTRAST


def _single_color_of_mark(item: InstanceObject, library: Library) -> tuple[float, ...] | None:
    """The colour of a mark; None for a solid object, or several colours."""
    model = load_object_model(item, library)
    colors = {shape.color for shape in model.visuals}
    return None if model.colliders or len(colors) != 1 else item.color or next(iter(colors))
