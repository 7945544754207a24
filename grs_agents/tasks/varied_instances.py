"""Varied instances of an accepted task: variations of the run's instances that the expert solves.

They have the format of a run's instances, so that the folder can be used like a run; the program is not needed.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.sim.arms.arm_files import make_robot_path_relative
from grs_agents.sim.goals.scores import SOLVED
from grs_agents.sim.instance.task_instance import hash_instance
from grs_agents.sim.rollouts import rollout
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.worker_pool import map_in_processes

MANIFEST: Final = "manifest.json"
_REMEDY: Final = "name another folder with --out"


class Base(Frozen):
    """An instance of the run, the base of variations."""

    seed: int
    hash: str  # see ``sim.hash_instance``


class VariedInstance(Frozen):
    """A varied instance, and the result of the expert's episode."""

    seed: int  # of the variation; its file, if solved, is ``instances/seed_<seed>.json``
    base: int  # the run's seed that it is a variation of
    hash: str = ""  # see ``sim.hash_instance``; empty if no instance could be drawn
    strict: float = 0.0  # strict score of the expert, 0..1
    published: float = 0.0
    solved: bool = False
    outcome: str = "error"  # of the expert's episode
    detail: str = ""  # reason if not solved


class VariationManifest(Frozen):
    """Contents of a folder of varied instances."""

    version: int = 1
    run: str  # the name of the run's folder
    variation: Variation
    bases: tuple[Base, ...]
    instances: tuple[VariedInstance, ...] = ()  # solved, by seed
    left_out: tuple[VariedInstance, ...] = ()  # not solved, by seed

    @property
    def seeds(self) -> frozenset[int]:
        """Seeds that were tried."""
        return frozenset(instance.seed for instance in (*self.instances, *self.left_out))

    def with_added_instance(self, added: VariedInstance) -> "VariationManifest":
        """The manifest with another instance."""
        key = "instances" if added.solved else "left_out"
        rows: tuple[VariedInstance, ...] = (*getattr(self, key), added)
        return self.model_copy(update={key: tuple(sorted(rows, key=lambda row: row.seed))})


def make_varied_instances(
    run: Path,
    seeds: Sequence[int],
    variation: Variation,
    out: Path,
    workers: int = 2,
    show: Callable[[VariationManifest], None] = lambda _: None,
) -> VariationManifest:
    """Make the instances of ``seeds`` that ``out`` lacks, and keep those that the expert solves.

    ``show`` is called after each. Existing instances are kept, so that an interrupted call resumes.

    Raises:
        InputError: the run cannot be used, or ``out`` holds something else.
    """
    folder = open_task_folder(run)
    manifest = _open_manifest(folder, variation, out)
    waiting = [seed for seed in dict.fromkeys(seeds) if seed not in manifest.seeds]
    show(manifest)
    for varied in map_in_processes(_make_varied_instance, waiting, workers, _set_job, (folder.path, variation, out)):
        manifest = manifest.with_added_instance(varied)
        write_json(out / MANIFEST, manifest.model_dump(mode="json"), durable=True)
        show(manifest)
    return manifest


def _open_manifest(folder: TaskFolder, variation: Variation, out: Path) -> VariationManifest:
    """The manifest in ``out``; for a new folder a new manifest, with the run's assets beside it."""
    if out.is_dir():
        check_run_folder(out)  # the folder may come from somebody else
    bases = tuple(Base(seed=seed, hash=hash_instance(folder.read_instance(seed))) for seed in folder.seeds)
    begun = VariationManifest(run=folder.path.resolve().name, variation=variation, bases=bases)
    if (out / MANIFEST).is_file():
        try:
            stored = VariationManifest.model_validate(read_json(out / MANIFEST, _REMEDY))
        except ValidationError as error:
            raise InputError(f"{out / MANIFEST} is no manifest of varied instances", _REMEDY) from error
        if (stored.bases, stored.variation) != (begun.bases, begun.variation):
            what = "another variation" if stored.bases == begun.bases else "variations of another run"
            raise InputError(f"{out} holds {what}", _REMEDY)
        return stored
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is there and holds no varied instances", _REMEDY)
    folder.copy_assets_and_robot(out)
    write_json(out / MANIFEST, begun.model_dump(mode="json"))
    return begun


_job: list[tuple[TaskFolder, Variation, Path]] = []


def _set_job(run: Path, variation: Variation, out: Path) -> None:
    _job[:] = [(open_task_folder(run), variation, out)]


def _make_varied_instance(seed: int) -> VariedInstance:
    """Draw an instance, let the expert solve it, and write it if solved."""
    folder, variation, out = _job[0]
    base = folder.seeds[seed % len(folder.seeds)]
    try:
        varied = vary_instance(folder.read_instance(base), variation, np.random.default_rng(seed), folder.library)
    except GrsError as error:
        return VariedInstance(seed=seed, base=base, outcome="no_scene", detail=str(error))
    instance = varied.model_copy(update={"seed": seed})
    done = rollout(instance, folder.library)
    episode = done.episode
    solved = episode.outcome == "success" and min(episode.reward, episode.strict) >= SOLVED > done.idle_reward
    if solved:
        written = make_robot_path_relative(instance, folder.path).model_dump(mode="json")
        write_json(out / "instances" / f"seed_{seed}.json", written, durable=True)
    return VariedInstance(
        seed=seed,
        base=base,
        hash=hash_instance(instance),
        strict=episode.strict,
        published=episode.reward,
        solved=solved,
        outcome=episode.outcome,
        detail="" if solved else "; ".join(filter(None, (episode.detail, *episode.shortfalls[:2]))),
    )
