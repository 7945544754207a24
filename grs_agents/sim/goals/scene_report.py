"""A scene in words and numbers: the target of each goal, and the motion of each object."""

import math
from collections.abc import Sequence
from typing import Final

from grs_agents.base import Vec3
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.planning_scene import PlanningScene, cannot_topple
from grs_agents.sim.goals.relation_rules import object_footprint_as_zone
from grs_agents.sim.instance.episode import ObjectMotion
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.world.footprints import object_prism_at_pose

_MOST_NAMED: Final = 8
_MOVED: Final = 0.02
_TURNED: Final = math.radians(15)


def describe_goal(goal: Goal, scene: PlanningScene, pos_eps: float) -> str:
    """A line on a goal: kind, target in numbers (m), objects; ``pos_eps`` is the task's tolerance (m)."""
    if goal.metric == "zone":
        return f"zone, {' or '.join(map(_format_zone, goal.zones))}: {_format_object_list(goal.objects, scene)}"
    if goal.metric == "pose":
        choices = [goal.allowed_target_indices(row) for row in range(len(goal.objects))]
        if all(choice == choices[0] for choice in choices):  # targets that the objects share
            targets = f"{_format_object_list(goal.objects, scene)} at {_format_targets(goal, 0, choices[0])}"
        else:
            pairs = [
                f"{scene.object_label(number)} at {_format_targets(goal, row, choices[row])}"
                for row, number in enumerate(goal.objects[:_MOST_NAMED])
            ]
            targets = ", ".join([*pairs, *(["..."] if len(goal.objects) > _MOST_NAMED else [])])
        return f"pose, within {pos_eps:.3g} m: {targets}"
    kind, bound = str(goal.relation_kind), goal.required_distance
    words = f"{kind}, from the bottom up" if kind == "stacked" else kind
    if len(goal.mentioned_object_ids) > len(goal.objects):
        reference = goal.reference_id
        prism = scene.object_prism(reference)
        shape = _format_zone(object_footprint_as_zone(reference, scene))
        words += f" {scene.object_label(reference)} ({shape}, top at {prism.high:.3f} m)"
    if bound is not None:
        words += f", {'gap at most' if kind == 'near' else 'spacing'} {bound:.3g} m"
    return f"{words}: {_format_object_list(goal.objects, scene)}"


def _format_object_list(numbers: Sequence[int], scene: PlanningScene) -> str:
    more = f" and {len(numbers) - _MOST_NAMED} more" if len(numbers) > _MOST_NAMED else ""
    return ", ".join(map(scene.object_label, numbers[:_MOST_NAMED])) + more


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


def measure_object_motions(scene: PlanningScene) -> tuple[ObjectMotion, ...]:
    """Displacement and tilt of every object since the scene had settled."""
    motions: list[ObjectMotion] = []
    for number in scene.object_ids:
        end, start = scene.object_pose(number), scene.places.get(number)
        if start is not None:
            tilt = (
                0.0 if cannot_topple(number, scene) else scene.object_tilt(number) - scene.object_tilt_at_start(number)
            )
            moved = math.dist(start[0], end[0]) > _MOVED or transforms.angle_between(start[1], end[1]) > _TURNED
            x0, y0, x1, y1 = object_prism_at_pose(scene.object_model(number), start).bounding_box_xy
            motions.append(
                ObjectMotion(
                    object=number,
                    asset=scene.object_name(number),
                    start=_round_point(start[0]),
                    end=_round_point(end[0]),
                    tilt=round(math.degrees(tilt), 1) + 0.0,
                    moved=moved,
                    extent=(round(x1 - x0, 4), round(y1 - y0, 4)),
                    color=scene.object_color(number),
                )
            )
    return tuple(motions)


def _round_point(point: Vec3) -> Vec3:
    x, y, z = (round(value, 4) for value in point)
    return (x, y, z)
