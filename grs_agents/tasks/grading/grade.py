"""How hard a task is, in one number that can be sorted by, with the figures that it is made of."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.tasks.grading.measures import Clutter, Tolerance, measure_clutter, measure_tolerance
from grs_agents.tasks.grading.trials import NOISES, GradeOrder, Show, Trials
from grs_agents.tasks.task_folder import TaskFolder


class GradePart(Frozen):
    """One of the figures that a task's difficulty is made of."""

    name: str
    value: float
    unit: str
    difficulty: float  # what it says, 0 easy .. 1 hard
    weight: float  # its share of the whole
    meaning: str


class Figures(Frozen):
    """What was measured of a task."""

    moves: float  # of the expert, mean
    clutter: Clutter
    tolerance: Tolerance
    noise_success: tuple[tuple[float, float], ...]  # metres by which the hand misses, share solved strictly
    half_noise: float  # metres by which the hand may miss until the expert solves half of what it does else
    random_success: float | None  # None where the task is to push
    learned_success: float | None
    demonstrations: int  # that the learned policy had


class Grade(Frozen):
    """How hard a task is."""

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
    figures = _measure_task_difficulty(folder, Trials(folder, order, workers, show))
    parts = _make_parts(figures)
    difficulty = sum(part.weight * part.difficulty for part in parts) / sum(part.weight for part in parts)
    return Grade(difficulty=round(difficulty, 3), parts=parts, figures=figures)


def _measure_task_difficulty(folder: TaskFolder, trials: Trials) -> Figures:
    levels = trials.noise_levels()
    moves = [one.moves for one in levels[0] if one.solved]
    if not moves:
        raise InputError(f"the expert solves no variation of {folder.path}", "name a task that was accepted")
    success = tuple(zip(NOISES, [float(np.mean([one.solved for one in level])) for level in levels], strict=False))
    bases = [folder.read_instance(seed) for seed in folder.seeds]
    pushes = any(base.primitive == "push" for base in bases)
    learned, demonstrations = (None, 0) if pushes else trials.learned_success()
    return Figures(
        moves=float(np.mean(moves)),
        clutter=_mean_clutter([measure_clutter(base, folder.library) for base in bases]),
        tolerance=_tightest_tolerance([measure_tolerance(base, folder.library) for base in bases]),
        noise_success=success,
        half_noise=noise_at_half_success(success),
        random_success=None if pushes else trials.random_success(),
        learned_success=learned,
        demonstrations=demonstrations,
    )


def _mean_clutter(found: Sequence[Clutter]) -> Clutter:
    crowds = [one.objects_per_square_metre for one in found]
    nearest = [one.nearest for one in found]
    return Clutter(nearest=float(np.mean(nearest)), objects_per_square_metre=float(np.mean(crowds)))


def _tightest_tolerance(found: Sequence[Tolerance]) -> Tolerance:
    return Tolerance(metres=min(one.metres for one in found), degrees=min(one.degrees for one in found))


def noise_at_half_success(levels: Sequence[tuple[float, float]]) -> float:
    """Metres at which success is half of what it is at the first level, between two of them; else the last of them."""
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


def _make_parts(figures: Figures) -> tuple[GradePart, ...]:
    """Each figure with what it says of the difficulty; those that were not measured are left out."""
    moves, noise = figures.moves, figures.half_noise
    play, gap = figures.tolerance.metres, figures.clutter.nearest
    rows = [
        ("moves", moves, "moves", moves / (moves + 4), 0.2),
        ("hand noise", noise, "m", 0.01 / (0.01 + noise), 0.2),
        ("tolerance", play, "m", 0.01 / (0.01 + play), 0.1),
        ("clutter", gap, "m", 0.05 / (0.05 + gap), 0.1),
    ]
    if figures.learned_success is not None and figures.random_success is not None:
        rows.append(("learned policy", figures.learned_success, "share", 1 - figures.learned_success, 0.3))
        rows.append(("random policy", figures.random_success, "share", 1 - figures.random_success, 0.1))
    return tuple(
        GradePart(name=name, value=value, unit=unit, difficulty=round(hard, 3), weight=weight, meaning=_MEANINGS[name])
        for name, value, unit, hard, weight in rows
    )
