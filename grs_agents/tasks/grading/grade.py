"""Difficulty of a task in a single number, with the figures that it is computed from."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import POSITION_TOLERANCE, TaskInstance
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import collider_prisms_at_pose, distance_between_outlines
from grs_agents.sim.world.spec import load_object_model
from grs_agents.tasks.grading.trials import NOISES, GradeOrder, Show, Trials
from grs_agents.tasks.task_folder import TaskFolder

_WORKSPACE: Final = 0.5
"""Area of the table for objects, m^2: 0.5 by 1 m."""
_FAR: Final = 0.3
"""Distance to obstacles in a scene without any, metres; also the tolerance of goals without a distance."""
_BESIDE: Final = 0.005
"""Height above an object's underside from which on an obstacle stands beside it, metres."""
_ANY_YAW: Final = 180.0


class Clutter(Frozen):
    """Clutter of a scene."""

    nearest: float  # mean distance from an object of a goal to the nearest obstacle, metres
    objects_per_square_metre: float


class Tolerance(Frozen):
    """Tolerance of the strictest goal."""

    metres: float
    degrees: float  # of yaw; 180 for any yaw


class GradePart(Frozen):
    """A figure with its share in the difficulty."""

    name: str
    value: float
    unit: str
    difficulty: float  # 0 easy .. 1 hard
    weight: float  # in the mean
    meaning: str


class Figures(Frozen):
    """Measurements of a task."""

    moves: float  # of the expert, mean
    clutter: Clutter
    tolerance: Tolerance
    noise_success: tuple[tuple[float, float], ...]  # error of the hand (m), share solved strictly
    half_noise: float  # error of the hand (m) at which the expert's success halves
    random_success: float | None  # None for pushing tasks
    learned_success: float | None
    demonstrations: int  # of the learned policy


class Grade(Frozen):
    """Difficulty of a task."""

    difficulty: float  # 0 easy .. 1 hard: the weighted mean of the parts
    parts: tuple[GradePart, ...]
    figures: Figures


def grade_task(
    folder: TaskFolder, order: GradeOrder, workers: int, show: Show = lambda stage, done, total: None
) -> Grade:
    """Grade the task of a folder.

    Raises:
        InputError: the expert solves none of the variations.
    """
    trials = Trials(folder, order, workers, show)
    levels = trials.noise_levels()
    moves = [episode.moves for episode in levels[0] if episode.solved]
    if not moves:
        raise InputError(f"the expert solves no variation of {folder.path}", "name a task that was accepted")
    shares = [float(np.mean([episode.solved for episode in level])) for level in levels]
    success = tuple(zip(NOISES, shares, strict=False))
    bases = [folder.read_instance(seed) for seed in folder.seeds]
    pushes = any(base.primitive == "push" for base in bases)
    learned, demonstrations = (None, 0) if pushes else trials.learned_success()
    clutters = [measure_clutter(base, folder.library) for base in bases]
    tolerances = [measure_tolerance(base, folder.library) for base in bases]
    figures = Figures(
        moves=float(np.mean(moves)),
        clutter=Clutter(
            nearest=float(np.mean([clutter.nearest for clutter in clutters])),
            objects_per_square_metre=float(np.mean([clutter.objects_per_square_metre for clutter in clutters])),
        ),
        tolerance=Tolerance(
            metres=min(tolerance.metres for tolerance in tolerances),
            degrees=min(tolerance.degrees for tolerance in tolerances),
        ),
        noise_success=success,
        half_noise=noise_at_half_success(success),
        random_success=None if pushes else trials.random_success(),
        learned_success=learned,
        demonstrations=demonstrations,
    )
    play, gap = figures.tolerance.metres, figures.clutter.nearest
    rows = [
        ("moves", figures.moves, "moves", figures.moves / (figures.moves + 4), 0.2),
        ("hand noise", figures.half_noise, "m", 0.01 / (0.01 + figures.half_noise), 0.2),
        ("tolerance", play, "m", 0.01 / (0.01 + play), 0.1),
        ("clutter", gap, "m", 0.05 / (0.05 + gap), 0.1),
    ]
    if figures.learned_success is not None and figures.random_success is not None:  # else they were not measured
        rows.append(("learned policy", figures.learned_success, "share", 1 - figures.learned_success, 0.3))
        rows.append(("random policy", figures.random_success, "share", 1 - figures.random_success, 0.1))
    parts = tuple(
        GradePart(name=name, value=value, unit=unit, difficulty=round(hard, 3), weight=weight, meaning=_MEANINGS[name])
        for name, value, unit, hard, weight in rows
    )
    difficulty = sum(part.weight * part.difficulty for part in parts) / sum(part.weight for part in parts)
    return Grade(difficulty=round(difficulty, 3), parts=parts, figures=figures)


def noise_at_half_success(levels: Sequence[tuple[float, float]]) -> float:
    """Error of the hand (m) at which success halves, interpolated between two levels; else the last level."""
    half = levels[0][1] / 2
    for (before, more), (after, less) in pairwise(levels):
        if less <= half < more:
            return before + (after - before) * (more - half) / (more - less)
    return levels[-1][0]


_MEANINGS = {
    "moves": "how many objects the expert carries; half hard at 4",
    "hand noise": "how far the hand may miss until the expert fails half of the time; half hard at 1 cm",
    "tolerance": "how far off the strictest goal lets an object be; half hard at 1 cm",
    "clutter": "how near other things stand to what is moved; half hard at 5 cm",
    "learned policy": "episodes solved by a small policy that imitates a few demonstrations",
    "random policy": "episodes that chance solves",
}


def measure_clutter(instance: TaskInstance, library: Library) -> Clutter:
    """Clutter of an instance at its start."""
    prisms = {
        item.id: collider_prisms_at_pose(load_object_model(item, library), item.pose, item.id)
        for item in instance.objects
    }
    wanted = {number for goal in instance.goals for number in goal.objects if prisms[number]}
    gaps: list[float] = []
    for number in wanted:
        parts = prisms[number]
        low, high = min(prism.low for prism in parts), max(prism.high for prism in parts)
        obstacles = [
            prism
            for key, row in prisms.items()
            for prism in row
            if key != number and prism.high > low + _BESIDE and prism.low < high
        ]
        gaps.append(
            min(
                (distance_between_outlines(part.outline, prism.outline) for part in parts for prism in obstacles),
                default=_FAR,
            )
        )
    solid = sum(bool(row) for row in prisms.values())
    return Clutter(nearest=float(np.mean(gaps)) if gaps else _FAR, objects_per_square_metre=solid / _WORKSPACE)


def measure_tolerance(instance: TaskInstance, library: Library) -> Tolerance:
    """Least tolerance of an instance's goals."""
    models = {item.id: load_object_model(item, library) for item in instance.objects}
    tolerances = [pair for goal in instance.goals for pair in _goal_tolerances(goal, instance, models, library)]
    return Tolerance(
        metres=min((metres for metres, _ in tolerances), default=_FAR),
        degrees=min((degrees for _, degrees in tolerances), default=_ANY_YAW),
    )


def _goal_tolerances(
    goal: Goal, instance: TaskInstance, models: dict[int, ObjectModel], library: Library
) -> Iterator[tuple[float, float]]:
    """Tolerances (metres, degrees) of each object of a goal."""
    for number, symmetry in zip(goal.objects, goal.symmetries, strict=True):
        if goal.metric == "pose":
            turns = goal.rotations and symmetry > 0
            yield instance.pos_eps, math.degrees(instance.rot_eps) if turns else _ANY_YAW
        elif goal.metric == "zone":
            sharers = {member for peer in instance.goals if peer.zones == goal.zones for member in peer.objects}
            yield max(_max_offset_in_rectangle(zone.size[:2], number, sharers, models) for zone in goal.zones), _ANY_YAW
        elif goal.relation_kind in ("inside", "in_zone"):
            model = models[goal.reference_id]
            room = measure_inner_size(model, library) if goal.relation_kind == "inside" else None
            sharers = {member for peer in instance.goals if peer.has_same_relation(goal) for member in peer.objects}
            yield _max_offset_in_rectangle((room or model.size)[:2], number, sharers, models), _ANY_YAW
        elif goal.relation_kind in ("stacked", "on"):
            carriers = goal.objects if goal.relation_kind == "stacked" else (goal.reference_id,)
            yield min(min(models[carrier].size[:2]) / 2 for carrier in carriers), _ANY_YAW
        else:
            distances = {"aligned": POSITION_TOLERANCE, "near": goal.required_distance}
            yield distances.get(str(goal.relation_kind)) or _FAR, _ANY_YAW


def _max_offset_in_rectangle(
    room: tuple[float, float], number: int, sharers: set[int], models: dict[int, ObjectModel]
) -> float:
    """Largest offset of an object in a rectangle, metres, limited by the sides and the area that others take."""
    size = sorted(models[number].size[:2])
    sides = [(have - need) / 2 for have, need in zip(sorted(room), size, strict=True)]
    taken = sum(math.prod(models[member].size[:2]) for member in sharers)
    spare = (math.sqrt(math.prod(room)) - math.sqrt(taken)) / 2
    return max(0.0, min(*sides, spare))
