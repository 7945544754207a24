"""Checks of the scenes themselves: as the photo shows them, apart at the start, at rest and undisturbed at the end."""

import math
from collections.abc import Iterator, Sequence, Set
from typing import Final

from grs_agents.audit.goal_checks import asset_with_id, pair_instances_with_rollouts
from grs_agents.audit.pose_changes import find_pose_changes, is_tilted
from grs_agents.audit.types import Finding, join_first_distinct
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout

DEPTH: Final = 0.005
"""Metres that one object may reach into another before the scene settles: what a photo's depth leaves open."""
SHIFT: Final = 0.02
SINK: Final = 0.03
"""What settling moves sideways, or up or down, by more than this (m) was not put where it can stand."""
LEVEL: Final = 0.75
"""Share of an object's weight that must rest on contacts that are nearly level; honest tasks have 0.97 or more."""
SQUEEZE: Final = 0.75
"""Sideways forces over the weight: less than 0.3 in honest tasks, 1.1 to 6 for what is wedged in a bowl."""
OPAQUE, BURIED = 0.5, 0.0005
"""Objects of a task are at least so opaque, and marks no deeper (m) under the table top: people must see them."""
DISTURBED: Final = 0.01
"""Metres that a bystander may move."""


def list_scene_findings(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], library: Library, scene: SceneDescription | None
) -> list[Finding]:
    """Findings about where things stand, in all instances."""
    pairs = pair_instances_with_rollouts(instances, rollouts)
    findings = [
        _check_objects_start_apart_and_stable(pairs),
        _check_objects_rest_at_end(pairs),
        _check_bystanders_undisturbed(pairs),
    ]
    return [_check_photo_poses(instances, scene, library), *findings] if scene is not None else findings


def _check_photo_poses(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> Finding:
    changes = find_pose_changes(instances, scene, library)
    moved = [change for change in changes if change.photo is not None and not change.reason]
    wrong = [
        f"{one.asset} is {(one.distance or 0.0) * 100:.0f} cm from there and turned by {one.turned or 0.0:.0f} degrees "
        f"in seed {one.seed}"
        for one in moved
    ]
    wrong += _describe_painted_or_tied_objects(instances, {item.asset for item in scene.objects})
    excused = [f"{change.asset} for it {change.reason}" for change in changes if change.reason]
    measured = join_first_distinct(wrong) or "everything that the photo shows stands as it shows it"
    if excused:
        measured += f"; moved with a reason: {join_first_distinct(excused)}"
    return Finding(
        check="photo_poses",
        passed=not wrong,
        measured=measured,
        bound="objects must stand as the photo shows them, unless out of reach, covered or unstable there, and look so",
    )


def _describe_painted_or_tied_objects(instances: Sequence[TaskInstance], shown: Set[str]) -> list[str]:
    """Words on what a program painted or tied together."""
    tied = [f"objects are tied in seed {instance.seed}" for instance in instances if instance.ties]
    painted = [item.asset for instance in instances for item in instance.task_objects if item.color is not None]
    return [*tied, *(f"{asset} is painted" for asset in painted if asset in shown)]


def _check_objects_start_apart_and_stable(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> Finding:
    faults = [fault for instance, rollout in pairs for fault in _describe_unstable_start(instance, rollout)]
    bound = f"nothing may reach {DEPTH * 1000:.0f} mm into another thing, a bystander stand on a mark, or settling "
    bound += f"move anything {SHIFT * 100:.0f} cm sideways, {SINK * 100:.0f} cm up or down, or tip it"
    return Finding.from_fault_list("clear_start", faults, "objects are apart, and stay where they are put", bound)


def _describe_unstable_start(instance: TaskInstance, rollout: Rollout) -> Iterator[str]:
    bystanders = {item.id for item in instance.objects if item.role == "bystander"}
    excused = [{tie.parent, tie.child} for tie in instance.ties]
    for one in rollout.overlaps:
        pair = {one.first, one.second}
        # How two bystanders stand is the photo's doing, not the program's; if it moves them, that is a fault.
        if one.depth > DEPTH and not pair <= bystanders and pair not in excused:
            names = f"{asset_with_id(instance, one.first)} and {asset_with_id(instance, one.second)}"
            yield f"{names} reach {one.depth * 1000:.0f} mm into each other"
    yield from _describe_invisible_objects(instance)
    for item in instance.objects:
        if item.id in rollout.initial and _has_settled_elsewhere(item, rollout):
            away = math.dist(item.pose[0], rollout.initial[item.id][0])
            yield f"settling moves {asset_with_id(instance, item.id)} by {away * 100:.1f} cm or tips it"


def _describe_invisible_objects(instance: TaskInstance) -> Iterator[str]:
    return (
        f"{asset_with_id(instance, item.id)} cannot be seen"
        for item in instance.task_objects
        if _is_transparent_or_buried(item)
    )


def _is_transparent_or_buried(item: InstanceObject) -> bool:
    """Whether an object is transparent, or a mark that lies under the table top."""
    colors = (item.color or (), item.fill.get("COLOR", ()))
    transparent = any(len(color) > 3 and float(color[3]) < OPAQUE for color in colors)
    return transparent or (item.asset.startswith("zone/") and item.pose[0][2] < -BURIED)


def _has_settled_elsewhere(item: InstanceObject, rollout: Rollout) -> bool:
    start, rest = item.pose, rollout.initial[item.id]
    moved = math.dist(start[0][:2], rest[0][:2]) > SHIFT or abs(start[0][2] - rest[0][2]) > SINK
    return moved or is_tilted(start, rest)


def _check_objects_rest_at_end(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> Finding:
    """Contacts and forces tell what stands from what hangs or is wedged, whatever its height."""
    faults = [
        f"{asset_with_id(instance, one.object)} rests on level ground with {one.carried:.0%} of its weight, "
        f"sideways forces are {one.squeeze:.1f} times it"
        for instance, rollout in pairs
        for one in rollout.supports
        if any(one.object in goal.objects for goal in instance.goals) and (one.carried < LEVEL or one.squeeze > SQUEEZE)
    ]
    bound = f"level contacts must carry {LEVEL:.0%} of the weight of each object of a goal, and sideways forces be "
    bound += f"at most {SQUEEZE} times it"
    return Finding.from_fault_list("rests_at_end", faults, "what was moved stands, and is not wedged", bound)


def _check_bystanders_undisturbed(pairs: Sequence[tuple[TaskInstance, Rollout]]) -> Finding:
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
    return Finding(
        check="undisturbed",
        passed=farthest <= DISTURBED and not tipped,
        measured=join_first_distinct([measured, *tipped]),
        bound=f"no bystander may move by more than {DISTURBED * 1000:.0f} mm or tilt by more than 15 degrees",
    )
