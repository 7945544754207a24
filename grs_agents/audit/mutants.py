"""Mutants: task instances with a single fault, on which good tests fail."""

import math
from collections.abc import Iterator, Sequence
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
"""Thresholds of a move: metres, radians."""
_STAND_INS: Final = ("block/red_block.urdf", "block/blue_block.urdf")
_PLACES: Final = ("inside", "on", "in_zone")
"""Relations that do not hold beside their reference."""
_WHOLE_ONLY: Final = ("stacked", "aligned")
"""Relations among several objects: without an object, the goal is another goal."""


@dataclass(frozen=True)
class Mutant:
    """A task instance with a fault."""

    kind: MutantKind
    what: str  # the fault in words
    instance: TaskInstance


def make_instance_mutants(instance: TaskInstance, solved: Rollout, library: Library) -> tuple[Mutant, ...]:
    """Make the mutants of an instance that the oracle solved.

    Only the last two moved objects are mutated, so that the cost does not grow with their number: the episodes of these
    mutants begin as the task's, which is simulated once.
    """
    items = {item.id: item for item in instance.objects}
    named = dict.fromkeys(number for goal in instance.goals for number in goal.objects)
    movers: list[InstanceObject] = []
    for number in (number for number in named if number in solved.final):
        start, end = solved.initial[number], solved.final[number]
        if math.dist(start[0], end[0]) > _MOVED or transforms.angle_between(start[1], end[1]) > _TURNED:
            movers.append(items[number])
    chosen = movers[-2:]
    mutants: list[Mutant] = []
    for item in chosen:
        goals: list[Goal] = []
        for goal in instance.goals:
            if item.id not in goal.objects:
                goals.append(goal)
            elif len(goal.objects) > 1 and goal.relation_kind not in _WHOLE_ONLY:
                rows = [row for row, object_id in enumerate(goal.objects) if object_id != item.id]
                fields = ("objects", "matches", "symmetries")
                kept = {name: tuple(getattr(goal, name)[row] for row in rows) for name in fields}
                goals.append(goal.model_copy(update=kept))
        what = f"nothing asks for {_asset_with_id(item)} any more"
        mutants.append(Mutant("goal_dropped", what, instance.model_copy(update={"goals": tuple(goals)})))
    mutants += [mutant for item in chosen if (mutant := _make_moved_target_mutant(instance, item)) is not None]
    mutants += _make_exchanged_places_mutant(instance, solved, chosen, library)
    for item in chosen[:1]:
        frozen = item.model_copy(update={"category": "fixed"})
        what = f"{_asset_with_id(item)} cannot be moved"
        mutants.append(_make_mutant_with_objects(instance, "object_frozen", what, frozen))
    for item in chosen[-1:]:
        # Another movable asset of the instance in the object's place, else a block. Its episode shares no beginning.
        movable = [mover for mover in instance.objects if mover.role == "task" and mover.category != "fixed"]
        usable = [mover.asset for mover in movable if not mover.fill]
        asset = next(name for name in (*usable, *_STAND_INS) if name != item.asset)
        stand_in = InstanceObject(id=item.id, asset=asset, pose=item.pose)
        low = item.pose[0][2] - load_object_model(item, library).size[2] / 2
        height = max(0.0, low) + load_object_model(stand_in, library).size[2] / 2
        pose = ((*item.pose[0][:2], height), (0.0, 0.0, 0.0, 1.0))
        what = f"{asset} stands where {_asset_with_id(item)} should"
        placed = stand_in.model_copy(update={"pose": pose})
        mutants.append(_make_mutant_with_objects(instance, "wrong_asset", what, placed))
    for count in sorted({len(chosen[:1]), len(movers)} - {0}):
        at_end = [item.model_copy(update={"pose": solved.final[item.id]}) for item in movers[:count]]
        names = ", ".join(map(_asset_with_id, movers[:count]))
        what = f"{names} {'start' if count > 1 else 'starts'} where the task wants it"
        mutants.append(_make_mutant_with_objects(instance, "goal_already_met", what, *at_end))
    return (*mutants, Mutant("undone", "all stands where it stood before once the goals were met", instance))


def _asset_with_id(item: InstanceObject) -> str:
    return f"{item.asset} #{item.id}"


def _make_moved_target_mutant(instance: TaskInstance, item: InstanceObject) -> Mutant | None:
    """Move the targets and zones of an object's goals along y towards the middle of the table, and ask for a place
    beside the reference of a typed goal.

    Returns: None if its goals have no place.
    """
    goals: list[Goal] = []
    beside = False
    for goal in instance.goals:
        goals.append(goal)
        if item.id in goal.objects and goal.relation is not None:
            if goal.relation_kind in _PLACES:
                beside = True
                relation = goal.relation.model_copy(update={"kind": "near", "distance": SHIFT})
                goals[-1] = goal.model_copy(update={"relation": relation})
        elif item.id in goal.objects:
            places = [*goal.targets, *(zone.pose for zone in goal.zones)]
            step = -math.copysign(SHIFT, places[0][0][1])
            shifted: list[Pose] = [((x, y + step, z), turn) for (x, y, z), turn in places]
            count = len(goal.targets)
            zones = [
                zone.model_copy(update={"pose": pose}) for zone, pose in zip(goal.zones, shifted[count:], strict=True)
            ]
            goals[-1] = goal.model_copy(update={"targets": tuple(shifted[:count]), "zones": tuple(zones)})
    if tuple(goals) == instance.goals:
        return None
    mutated = instance.model_copy(update={"goals": tuple(goals)})
    if beside:
        return Mutant("put_beside", f"{_asset_with_id(item)} is to end beside its place", mutated)
    what = f"the target of {_asset_with_id(item)} is {SHIFT * 100:.0f} cm away from where it was"
    return Mutant("target_moved", what, mutated)


def _make_exchanged_places_mutant(
    instance: TaskInstance, solved: Rollout, chosen: Sequence[InstanceObject], library: Library
) -> Iterator[Mutant]:
    """Exchange the places of two objects; no mutant if they are alike, or end in or on the same objects."""
    if len(chosen) < 2 or (chosen[0].asset, chosen[0].fill) == (chosen[1].asset, chosen[1].fill):
        return
    first, second = chosen
    rows = {row["id"]: row.get("ends", ()) for row in describe_task_in_words(instance, solved, library).objects}
    if set(rows[first.id]) == set(rows[second.id]):
        return
    flat: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    exchanged = {first.id: second.id, second.id: first.id}
    heights = {item.id: -object_prism_at_pose(load_object_model(item, library), flat, item.id).low for item in chosen}
    goals: list[Goal] = []
    for goal in instance.goals:
        members = [number for number in goal.objects if number in exchanged]
        single = len(goal.objects) == len(members) == 1  # the target rises by the difference of the rest heights
        rise = heights[exchanged[members[0]]] - heights[members[0]] if single else 0.0
        targets = tuple(((x, y, z + rise), turn) for (x, y, z), turn in goal.targets)
        objects = tuple(exchanged.get(number, number) for number in goal.objects)
        goals.append(goal.model_copy(update={"objects": objects, "targets": targets}))
    what = f"{_asset_with_id(first)} and {_asset_with_id(second)} are each to end where the other one is"
    yield Mutant("exchanged", what, instance.model_copy(update={"goals": tuple(goals)}))


def _make_mutant_with_objects(instance: TaskInstance, kind: MutantKind, what: str, *items: InstanceObject) -> Mutant:
    changed = {item.id: item for item in items}
    objects = tuple(changed.get(item.id, item) for item in instance.objects)
    return Mutant(kind, what, instance.model_copy(update={"objects": objects}))
