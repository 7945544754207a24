"""Mutants: task instances with one fault each, which tests with teeth tell from the instance that was audited."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from grs_agents.audit.goal_sentences import describe_task_in_words
from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.footprints import object_prism_at_pose
from grs_agents.sim.world.spec import load_object_model

MutantKind = Literal[
    "goal_dropped",
    "target_moved",
    "put_beside",
    "exchanged",
    "object_frozen",
    "wrong_asset",
    "goal_already_met",
    "undone",
]
SHIFT: Final = 0.05
"""Metres that a target is moved: five times the tolerance of a pose, and the least that a move is to be."""
_MOVED, _TURNED = 0.02, math.radians(15)
"""What has changed by more was moved, metres and radians."""
_STAND_INS: Final = ("block/red_block.urdf", "block/blue_block.urdf")
_PLACES: Final = ("inside", "on", "in_zone")
"""Relations to something that beside it do not hold."""
_WHOLE_ONLY: Final = ("stacked", "aligned")
"""Relations of several objects to one another: without one of them such a goal is another."""


@dataclass(frozen=True)
class Mutant:
    """One fault."""

    kind: MutantKind
    what: str  # the fault in words
    instance: TaskInstance


def make_instance_mutants(instance: TaskInstance, solved: Rollout, library: Library) -> tuple[Mutant, ...]:
    """Mutants of an instance that the oracle solved.

    The last two objects that it moved stand for all, so that the cost does not grow with their number: the episodes of
    these mutants begin as that of the task does, which is simulated once.
    """
    movers = _find_moved_objects(instance, solved)
    chosen = movers[-2:]
    made = [_make_goal_dropped_mutant(instance, item) for item in chosen]
    made += [mutant for item in chosen if (mutant := _make_moved_target_mutant(instance, item)) is not None]
    made += _make_exchanged_places_mutant(instance, solved, chosen, library)
    made += [_make_frozen_object_mutant(instance, item) for item in chosen[:1]]
    made += [
        _make_wrong_asset_mutant(instance, item, library) for item in chosen[-1:]
    ]  # nothing of its episode is shared
    made += [
        _make_goal_met_mutant(instance, solved, movers[:count])
        for count in sorted({len(chosen[:1]), len(movers)} - {0})
    ]
    return (*made, Mutant("undone", "all stands where it stood before once the goals were met", instance))


def _find_moved_objects(instance: TaskInstance, solved: Rollout) -> tuple[InstanceObject, ...]:
    """The objects of goals that the oracle moved, in the order of the goals."""
    items = {item.id: item for item in instance.objects}
    named = dict.fromkeys(number for goal in instance.goals for number in goal.objects)
    return tuple(items[n] for n in named if n in solved.final and _has_moved(solved.initial[n], solved.final[n]))


def _has_moved(start: Pose, end: Pose) -> bool:
    return math.dist(start[0], end[0]) > _MOVED or transforms.angle_between(start[1], end[1]) > _TURNED


def _asset_with_id(item: InstanceObject) -> str:
    return f"{item.asset} #{item.id}"


def _make_goal_dropped_mutant(instance: TaskInstance, item: InstanceObject) -> Mutant:
    goals = tuple(kept for goal in instance.goals for kept in _remove_object_from_goal(goal, item.id))
    what = f"nothing asks for {_asset_with_id(item)} any more"
    return Mutant("goal_dropped", what, instance.model_copy(update={"goals": goals}))


def _remove_object_from_goal(goal: Goal, number: int) -> Iterator[Goal]:
    """The goal without an object; nothing where it makes no sense without."""
    if number not in goal.objects:
        yield goal
    elif len(goal.objects) > 1 and goal.relation_kind not in _WHOLE_ONLY:
        rows = [row for row, other in enumerate(goal.objects) if other != number]
        fields = ("objects", "matches", "symmetries")
        yield goal.model_copy(update={name: tuple(getattr(goal, name)[row] for row in rows) for name in fields})


def _make_moved_target_mutant(instance: TaskInstance, item: InstanceObject) -> Mutant | None:
    """The targets and zones of the object's goals moved along y, towards the middle of the table, and what a typed goal
    wants in or on something wanted beside that; None where its goals have no such place."""
    goals = tuple(_move_target_of_goal(goal) if item.id in goal.objects else goal for goal in instance.goals)
    if goals == instance.goals:
        return None
    mutated = instance.model_copy(update={"goals": goals})
    if any(_is_place(goal) and item.id in goal.objects for goal in instance.goals):
        return Mutant("put_beside", f"{_asset_with_id(item)} is to end beside its place", mutated)
    what = f"the target of {_asset_with_id(item)} is {SHIFT * 100:.0f} cm away from where it was"
    return Mutant("target_moved", what, mutated)


def _make_exchanged_places_mutant(
    instance: TaskInstance, solved: Rollout, chosen: Sequence[InstanceObject], library: Library
) -> Iterator[Mutant]:
    """Each of two objects is to end where the other one is: none where they are alike, or end in or on the same."""
    if len(chosen) < 2 or (chosen[0].asset, chosen[0].fill) == (chosen[1].asset, chosen[1].fill):
        return
    one, other = chosen
    rows = {row["id"]: row.get("ends", ()) for row in describe_task_in_words(instance, solved, library).objects}
    if set(rows[one.id]) == set(rows[other.id]):
        return
    names, heights = {one.id: other.id, other.id: one.id}, _rest_heights(chosen, library)
    goals = tuple(_exchange_objects_of_goal(goal, names, heights) for goal in instance.goals)
    what = f"{_asset_with_id(one)} and {_asset_with_id(other)} are each to end where the other one is"
    yield Mutant("exchanged", what, instance.model_copy(update={"goals": goals}))


def _rest_heights(items: Sequence[InstanceObject], library: Library) -> dict[int, float]:
    """How far the origin of each object is above what it stands on, metres."""
    flat: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return {item.id: -object_prism_at_pose(load_object_model(item, library), flat, item.id).low for item in items}


def _exchange_objects_of_goal(goal: Goal, names: Mapping[int, int], heights: Mapping[int, float]) -> Goal:
    """The goal with other objects; a target for one alone is raised or lowered to where the other one rests."""
    mine = [number for number in goal.objects if number in names]
    rise = heights[names[mine[0]]] - heights[mine[0]] if len(goal.objects) == len(mine) == 1 else 0.0
    targets = tuple(((x, y, z + rise), turn) for (x, y, z), turn in goal.targets)
    objects = tuple(names.get(number, number) for number in goal.objects)
    return goal.model_copy(update={"objects": objects, "targets": targets})


def _is_place(goal: Goal) -> bool:
    return goal.relation is not None and goal.relation_kind in _PLACES


def _move_target_of_goal(goal: Goal) -> Goal:
    """The goal with another place; the same where it has none."""
    if goal.relation is not None:
        beside = goal.relation.model_copy(update={"kind": "near", "distance": SHIFT})
        return goal.model_copy(update={"relation": beside}) if _is_place(goal) else goal
    places = [*goal.targets, *(zone.pose for zone in goal.zones)]
    step = -math.copysign(SHIFT, places[0][0][1])

    def shift_pose_along_y(pose: Pose) -> Pose:
        (x, y, z), turn = pose
        return (x, y + step, z), turn

    zones = tuple(zone.model_copy(update={"pose": shift_pose_along_y(zone.pose)}) for zone in goal.zones)
    return goal.model_copy(update={"targets": tuple(map(shift_pose_along_y, goal.targets)), "zones": zones})


def _make_frozen_object_mutant(instance: TaskInstance, item: InstanceObject) -> Mutant:
    frozen = item.model_copy(update={"category": "fixed"})
    return _make_mutant_with_objects(instance, "object_frozen", f"{_asset_with_id(item)} cannot be moved", frozen)


def _make_wrong_asset_mutant(instance: TaskInstance, item: InstanceObject, library: Library) -> Mutant:
    """Another movable asset of the instance in the place of an object, else a block."""
    others = [other for other in instance.objects if other.role == "task" and other.category != "fixed"]
    usable = [other.asset for other in others if not other.fill]
    asset = next(name for name in (*usable, *_STAND_INS) if name != item.asset)
    other = InstanceObject(id=item.id, asset=asset, pose=item.pose)
    low = item.pose[0][2] - load_object_model(item, library).size[2] / 2
    height = max(0.0, low) + load_object_model(other, library).size[2] / 2
    pose = ((*item.pose[0][:2], height), (0.0, 0.0, 0.0, 1.0))
    what = f"{asset} stands where {_asset_with_id(item)} should"
    return _make_mutant_with_objects(instance, "wrong_asset", what, other.model_copy(update={"pose": pose}))


def _make_mutant_with_objects(instance: TaskInstance, kind: MutantKind, what: str, *items: InstanceObject) -> Mutant:
    changed = {item.id: item for item in items}
    objects = tuple(changed.get(item.id, item) for item in instance.objects)
    return Mutant(kind, what, instance.model_copy(update={"objects": objects}))


def _make_goal_met_mutant(instance: TaskInstance, solved: Rollout, items: Sequence[InstanceObject]) -> Mutant:
    at_end = [item.model_copy(update={"pose": solved.final[item.id]}) for item in items]
    what = f"{', '.join(map(_asset_with_id, items))} {'start' if len(items) > 1 else 'starts'} where the task wants it"
    return _make_mutant_with_objects(instance, "goal_already_met", what, *at_end)
