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
from grs_agents.sim.arms.arm_files import ROBOT_FOLDER, copy_arm_files, find_arm_file, make_robot_path_relative
from grs_agents.sim.arms.registry import ROBOTS, get_arm
from grs_agents.sim.goals.scores import SOLVED
from grs_agents.sim.instance.task_instance import TaskInstance, hash_instance
from grs_agents.sim.rollouts import rollout
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.worker_pool import map_in_processes

MANIFEST: Final = "manifest.json"
_REMEDY: Final = "name another folder with --out"


class Robot(Frozen):
    """A robot to solve a task: its arm, and the hand at its flange, by configured name."""

    robot: str  # or the path of an arm's file
    hand: str

    @property
    def folder_name(self) -> str:
        """Name of the folder of its instances."""
        return f"{Path(self.robot).stem}-{self.hand}"

    def take_over(self, instance: TaskInstance) -> TaskInstance:
        """The instance for this robot."""
        return instance.model_copy(update=self.model_dump())


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
    robot: Robot | None = None  # None for the run's own
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
    robot: Robot | None = None,
) -> VariationManifest:
    """Make the instances of ``seeds`` that ``out`` lacks, and keep those that the expert solves.

    ``show`` is called after each. Existing instances are kept, so that an interrupted call resumes. ``robot`` takes the
    place of the run's own.

    Raises:
        InputError: the run cannot be used, ``out`` holds something else, or the robot's file holds no arm.
        UnknownNameError: there is no such robot or hand.
    """
    folder = open_task_folder(run)
    if robot is not None:
        get_arm(robot.robot, robot.hand)
    manifest = _open_manifest(folder, variation, robot, out)
    if robot is not None:
        robot = robot.model_copy(update={"robot": find_arm_file(out, robot.robot)})
    waiting = [seed for seed in dict.fromkeys(seeds) if seed not in manifest.seeds]
    show(manifest)
    for varied in map_in_processes(
        _make_varied_instance, waiting, workers, _set_job, (folder.path, variation, robot, out)
    ):
        manifest = manifest.with_added_instance(varied)
        write_json(out / MANIFEST, manifest.model_dump(mode="json"), durable=True)
        show(manifest)
    return manifest


def _open_manifest(folder: TaskFolder, variation: Variation, robot: Robot | None, out: Path) -> VariationManifest:
    """The manifest in ``out``; for a new folder a new manifest, with the run's assets and the arm's file beside it."""
    if out.is_dir():
        check_run_folder(out)  # the folder may come from somebody else
    bases = tuple(Base(seed=seed, hash=hash_instance(folder.read_instance(seed))) for seed in folder.seeds)
    begun = VariationManifest(run=folder.path.resolve().name, variation=variation, robot=robot, bases=bases)
    if (out / MANIFEST).is_file():
        try:
            stored = VariationManifest.model_validate(read_json(out / MANIFEST, _REMEDY))
        except ValidationError as error:
            raise InputError(f"{out / MANIFEST} is no manifest of varied instances", _REMEDY) from error
        same_robot = _resolve_robot(stored.robot) == _resolve_robot(robot)
        if not same_robot or (stored.bases, stored.variation) != (begun.bases, begun.variation):
            what = "variations of another run"
            if stored.bases == begun.bases:
                what = "another variation" if same_robot else "instances for another robot"
            raise InputError(f"{out} holds {what}", _REMEDY)
        return stored
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is there and holds no varied instances", _REMEDY)
    folder.copy_assets_and_robot(out)
    file = None if robot is None or robot.robot in ROBOTS else Path(robot.robot).resolve()
    if file is not None and copy_arm_files(file, out / ROBOT_FOLDER) is None:
        raise InputError(f"{file} names files outside its folder", "put them beside it, by relative paths")
    write_json(out / MANIFEST, begun.model_dump(mode="json"))
    return begun


def _resolve_robot(robot: Robot | None) -> Robot | None:
    """The robot with the absolute path of an arm's file."""
    if robot is None or robot.robot in ROBOTS:
        return robot
    return robot.model_copy(update={"robot": str(Path(robot.robot).resolve())})


_job: list[tuple[TaskFolder, Variation, Robot | None, Path]] = []


def _set_job(run: Path, variation: Variation, robot: Robot | None, out: Path) -> None:
    _job[:] = [(open_task_folder(run), variation, robot, out)]


def _make_varied_instance(seed: int) -> VariedInstance:
    """Draw an instance, let the expert solve it, and write it if solved."""
    folder, variation, robot, out = _job[0]
    base = folder.seeds[seed % len(folder.seeds)]
    instance = folder.read_instance(base)
    if robot is not None:
        instance = robot.take_over(instance)
    try:
        varied = vary_instance(instance, variation, np.random.default_rng(seed), folder.library)
    except GrsError as error:
        return VariedInstance(seed=seed, base=base, outcome="no_scene", detail=str(error))
    instance = varied.model_copy(update={"seed": seed})
    done = rollout(instance, folder.library)
    episode = done.episode
    solved = episode.outcome == "success" and min(episode.reward, episode.strict) >= SOLVED > done.idle_reward
    if solved:
        written = make_robot_path_relative(instance, folder.path if robot is None else out).model_dump(mode="json")
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
