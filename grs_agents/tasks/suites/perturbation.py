"""Perturbations of episodes by factor, and the regression of success on them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, Literal, get_args

import numpy as np

from grs_agents.base import Frozen, Pose
from grs_agents.base.errors import GrsError
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.sim.goals.scores import SOLVED
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import rollout
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.sim.wording.sentence import paraphrase_task
from grs_agents.tasks.suites.statistics import Coefficient, Interval, clustered_interval, fit_log_odds

Factor = Literal["camera", "light", "table", "pose", "distractors", "mass", "friction", "words"]
FACTORS: Final[tuple[Factor, ...]] = get_args(Factor)
_VARIED: Final[Mapping[Factor, Mapping[str, float | bool]]] = {
    "light": {"light": True},
    "table": {"texture": True},
    "pose": {"jitter": 0.03, "yaw": np.deg2rad(30)},
    "distractors": {"distractors": 3},
    "mass": {"mass": 0.5},
    "friction": {"friction": 0.5},
}
_AWAY, _TURNED = 0.03, np.deg2rad(5)
"""Largest shift (m) along and turn (rad) about each axis of the cameras: a tripod that was put up again."""
_DRAWS: Final = 5
"""Scenes drawn until the expert solves one."""
_TOLD: Final = ("color", "size")
"""Tags of an instruction that are factors of success, too: it tells objects by them."""


class PerturbedEpisode(Frozen):
    """An episode after its perturbation."""

    instance: TaskInstance
    factors: tuple[Factor, ...]  # that were drawn; without scene factors if the expert solved none of the scenes
    instruction: str | None = None  # None without ``words``
    camera: Pose | None = None  # of each camera in its unperturbed frame, m


def perturb_episode(instance: TaskInstance, factors: Sequence[Factor], seed: int, library: Library) -> PerturbedEpisode:
    """Draw the factors of an episode; the expert solves the scene."""
    fields = {name: value for factor in factors for name, value in _VARIED.get(factor, {}).items()}
    varied = instance
    drawn: tuple[Factor, ...] = tuple(factor for factor in factors if factor not in _VARIED)
    for attempt in range(_DRAWS if fields else 0):
        rng = np.random.default_rng((seed, attempt))
        try:
            varied = vary_instance(instance, Variation.model_validate(fields), rng, library)
        except GrsError:  # no such scene
            varied = instance
            continue
        episode = rollout(varied, library).episode
        if episode.outcome == "success" and min(episode.reward, episode.strict) >= SOLVED:
            drawn = tuple(factors)
            break
        varied = instance
    rng = np.random.default_rng((seed, _DRAWS))
    shift, turn = rng.uniform(-_AWAY, _AWAY, 3), rng.uniform(-_TURNED, _TURNED, 3)
    choice = int(rng.integers(2**16))
    texts = paraphrase_task(varied, library) if "words" in drawn else ()
    return PerturbedEpisode(
        instance=varied,
        factors=drawn,
        instruction=texts[choice % len(texts)] if texts else None,
        camera=(transforms.to_vec3(shift), transforms.eulerXYZ_to_quatXYZW(transforms.to_vec3(turn)))
        if "camera" in drawn
        else None,
    )


class Effect(Frozen):
    """Effect of a factor on success."""

    factor: str  # a ``Factor``; ``told by color`` and ``told by size``: of the instruction
    alone: Interval  # success in the episodes without any other perturbation
    log_odds: Coefficient  # of success, with the factor against without it

    @property
    def verdict(self) -> Literal["costs success", "helps", "not shown"]:
        """Sign of the effect, where its interval excludes zero."""
        if self.log_odds.high < 0:
            return "costs success"
        return "helps" if self.log_odds.low > 0 else "not shown"


class Trial(Frozen):
    """An episode in the regression."""

    task: str
    factors: tuple[Factor, ...]
    tags: tuple[str, ...]  # of its instruction
    success: bool


def fit_effects(trials: Sequence[Trial]) -> tuple[Effect, ...]:
    """Effects of all factors that vary among the episodes and can be told apart.

    The factors of a draw count each episode. For an instruction's tags all episodes of a task with the same tags count
    as a single one, since they are alike.
    """
    names = [*FACTORS, *(f"told by {tag}" for tag in _TOLD)]
    table = np.array(
        [[*(factor in trial.factors for factor in FACTORS), *(tag in trial.tags for tag in _TOLD)] for trial in trials],
        dtype=np.float64,
    ).reshape(len(trials), len(names))
    kept: list[int] = []
    for column in range(len(names)):
        tried = np.column_stack([np.ones(len(trials)), table[:, [*kept, column]]])
        if len(trials) and np.linalg.matrix_rank(tried) == tried.shape[1]:
            kept.append(column)
    if not kept:
        return ()
    success = np.array([float(trial.success) for trial in trials])
    sizes = Counter((trial.task, trial.tags) for trial in trials)
    by_episode = fit_log_odds(table[:, kept], success, np.ones(len(trials)))
    shares = np.array([1 / sizes[trial.task, trial.tags] for trial in trials])
    tagged = kept[-1] >= len(FACTORS)
    by_instruction = fit_log_odds(table[:, kept], success, shares) if tagged else by_episode
    effects: list[Effect] = []
    for place, column in enumerate(kept):
        tag = column >= len(FACTORS)
        drawn = 0 if tag else 1
        alone = [trial for trial, row in zip(trials, table, strict=True) if row[column] and len(trial.factors) == drawn]
        fitted = (by_instruction if tag else by_episode)[place]
        effects.append(Effect(factor=names[column], alone=_success_by_task(alone), log_odds=fitted))
    return tuple(effects)


def _success_by_task(trials: Sequence[Trial]) -> Interval:
    """Success, clustered by task."""
    tasks: dict[str, list[float]] = {}
    for trial in trials:
        tasks.setdefault(trial.task, []).append(float(trial.success))
    return clustered_interval(list(tasks.values()))
