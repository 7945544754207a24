"""A scene in words and numbers: what each goal asks for, and where each object began and is."""

import math
from collections.abc import Sequence
from typing import Final

from grs_agents.base import Vec3
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.relation_rules import object_footprint_as_zone
from grs_agents.sim.goals.scene_view import SceneView, cannot_topple
from grs_agents.sim.instance.episode import ObjectMotion
from grs_agents.sim.instance.goal import Goal, Zone

_MOST_NAMED: Final = 8
_MOVED: Final = 0.02
_TURNED: Final = math.radians(15)


def describe_goal(goal: Goal, view: SceneView, pos_eps: float) -> str:
    """One line: the kind of a goal, its target in numbers (m), its objects; ``pos_eps`` is the task's tolerance (m)."""
    if goal.metric == "zone":
        return f"zone, {' or '.join(map(_format_zone, goal.zones))}: {_format_object_list(goal.objects, view)}"
    if goal.metric == "pose":
        return f"pose, within {pos_eps:.3g} m: {_describe_targets(goal, view)}"
    kind, bound = str(goal.relation_kind), goal.required_distance
    words = f"{kind}, from the bottom up" if kind == "stacked" else kind
    if len(goal.mentioned_object_ids) > len(goal.objects):
        reference = goal.reference_id
        prism = view.object_prism(reference)
        shape = _format_zone(object_footprint_as_zone(reference, view))
        words += f" {view.object_label(reference)} ({shape}, top at {prism.high:.3f} m)"
    if bound is not None:
        words += f", {'gap at most' if kind == 'near' else 'spacing'} {bound:.3g} m"
    return f"{words}: {_format_object_list(goal.objects, view)}"


def _format_object_list(numbers: Sequence[int], view: SceneView) -> str:
    more = f" and {len(numbers) - _MOST_NAMED} more" if len(numbers) > _MOST_NAMED else ""
    return ", ".join(map(view.object_label, numbers[:_MOST_NAMED])) + more


def _describe_targets(goal: Goal, view: SceneView) -> str:
    """Each object with its targets, or all of them with those that they share."""
    choices = [goal.allowed_target_indices(row) for row in range(len(goal.objects))]
    if all(choice == choices[0] for choice in choices):
        return f"{_format_object_list(goal.objects, view)} at {_format_targets(goal, 0, choices[0])}"
    pairs = [
        f"{view.object_label(number)} at {_format_targets(goal, row, choices[row])}"
        for row, number in enumerate(goal.objects[:_MOST_NAMED])
    ]
    return ", ".join([*pairs, *(["..."] if len(goal.objects) > _MOST_NAMED else [])])


def _format_targets(goal: Goal, row: int, choice: Sequence[int]) -> str:
    places = [format_point(goal.targets[index][0]) for index in choice[:_MOST_NAMED]]
    if goal.symmetries[row] > 0:
        yaws = [math.degrees(transforms.yaw_of_quaternion(goal.targets[index][1])) for index in choice[:_MOST_NAMED]]
        places = [f"{place} turned by {yaw:.0f} degrees" for place, yaw in zip(places, yaws, strict=True)]
    more = f" or {len(choice) - _MOST_NAMED} others" if len(choice) > _MOST_NAMED else ""
    return (" or ".join(places) or "no target at all") + more


def _format_zone(zone: Zone) -> str:
    return f"{zone.size[0]:.3f} x {zone.size[1]:.3f} m around ({zone.pose[0][0]:.3f}, {zone.pose[0][1]:.3f})"


def format_point(point: Sequence[float]) -> str:
    """A point (x, y, z) in words, to the millimetre."""
    return f"({point[0]:.3f}, {point[1]:.3f}, {point[2]:.3f})"


def measure_object_motions(view: SceneView) -> tuple[ObjectMotion, ...]:
    """How far every object is from where it stood when the scene had settled."""
    motions: list[ObjectMotion] = []
    for number in view.object_ids:
        end, start = view.object_pose(number), view.places.get(number)
        if start is not None:
            tilt = 0.0 if cannot_topple(number, view) else view.object_tilt(number) - view.object_tilt_at_start(number)
            moved = math.dist(start[0], end[0]) > _MOVED or transforms.angle_between(start[1], end[1]) > _TURNED
            motions.append(
                ObjectMotion(
                    object=number,
                    asset=view.object_name(number),
                    start=_round_point(start[0]),
                    end=_round_point(end[0]),
                    tilt=round(math.degrees(tilt), 1) + 0.0,
                    moved=moved,
                )
            )
    return tuple(motions)


def _round_point(point: Vec3) -> Vec3:
    x, y, z = (round(value, 4) for value in point)
    return (x, y, z)
