"""Data sets: the demonstrations of a working folder written in one of the formats, with a card."""

import hashlib
import importlib
import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from grs_agents.base.errors import ConfigError, GrsError, InputError
from grs_agents.base.files import write_json, write_text
from grs_agents.sim.arms.arm_files import make_robot_path_relative
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.lerobot import write_lerobot
from grs_agents.tasks.demos.minari import minari_id, write_minari
from grs_agents.tasks.demos.production import DemoOrder
from grs_agents.tasks.demos.robomimic import FILE, write_robomimic
from grs_agents.tasks.demos.types import DatasetCard, DatasetSummary, Demonstration, Format, installed_versions
from grs_agents.tasks.task_folder import DATASET_FILE, TaskFolder

Writer = Callable[[Iterable[Demonstration], DatasetCard, Path], None]
_WRITERS: Final[dict[Format, Writer]] = {
    "lerobot": write_lerobot,
    "robomimic": write_robomimic,
    "minari": write_minari,
}
_PACKAGES: Final[dict[Format, tuple[str, ...]]] = {
    "lerobot": ("pyarrow", "av"),
    "robomimic": ("h5py",),
    "minari": ("minari", "h5py"),
}
_EXTRAS: Final[dict[Format, str]] = {"lerobot": "demos", "robomimic": "demos", "minari": "minari"}
_REASONS: Final = 5


def check_format_requirements(kind: Format, order: DemoOrder) -> None:
    """Check before anything is simulated that a format can be written.

    Raises ``ConfigError`` for a missing package, ``InputError`` for pictures of a size that no film has.
    """
    for package in _PACKAGES[kind]:
        try:
            importlib.import_module(package)
        except ImportError as error:
            extra = f'run: pip install "grs-agents[{_EXTRAS[kind]}]"'
            raise ConfigError(f"{package}, which --format {kind} needs, is not installed", extra) from error
    if kind == "lerobot" and order.cameras and any(side % 2 for side in order.size):
        size = f"{order.size[0]}x{order.size[1]}"
        raise InputError(
            f"pictures of {size}: a film has an even number of rows and columns", "use e.g. --size 224x224"
        )


def write_dataset(store: AttemptStore, kind: Format, out: Path, folder: TaskFolder) -> DatasetSummary:
    """Write a data set to ``out``, whole or not at all, and remove the working folder.

    ``out`` is a task folder too: ``instances/seed_<N>.json`` is the instance of episode N; ``grs.json`` describes the
    episodes and cameras. Raises ``GrsError``: no attempt gave a demonstration.
    """
    dropped = store.read_dropped_attempts()
    counted = Counter(f"{attempt.stage}: {attempt.why}" for attempt in dropped).most_common(_REASONS)
    reasons = tuple(f"{count} x {why}" for why, count in counted)
    first = next(store.demonstrations(), None)
    if first is None:
        message = f"none of {len(dropped)} attempts gave a demonstration: {'; '.join(reasons)}"
        shutil.rmtree(store.path)
        raise GrsError(message, "vary less")
    content = json.dumps([kind, store.order, store.count], sort_keys=True)
    card = DatasetCard(
        name=folder.path.resolve().name,
        id=hashlib.sha256(content.encode()).hexdigest()[:32],
        folder=str(out.resolve()),
        robot=first.robot,
        control=first.control,
        rate=first.rate,
        joint_names=first.joint_names,
        gripper=first.gripper is not None,
        object_names=first.object_names,
        cameras=first.cameras,
        versions=installed_versions(),
    )
    draft = store.path / "dataset"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    episodes: list[dict[str, Any]] = []
    _WRITERS[kind](_write_instances_and_yield_demonstrations(store, folder, draft, episodes), card, draft)
    stages = dict(Counter(attempt.stage for attempt in dropped))
    description = {"format": kind, "dataset": card.model_dump(), "order": store.order}
    write_json(draft / DATASET_FILE, {**description, "dropped": stages, "episodes": episodes})
    folder.copy_assets_and_robot(draft)
    draft.rename(out)
    shutil.rmtree(store.path)
    if kind == "lerobot":
        opens_with = f"LeRobotDataset({f'grs/{card.name}'!r}, root={str(out)!r})"
    elif kind == "robomimic":
        opens_with = f"h5py.File({str(out / FILE)!r})"
    else:
        opens_with = f"minari.MinariDataset({str(out / minari_id(card) / 'data')!r})"
    return DatasetSummary(
        format=kind,
        out=str(out),
        episodes=len(episodes),
        steps=sum(int(episode["steps"]) for episode in episodes),
        dropped=stages,
        reasons=reasons,
        opens_with=opens_with,
    )


def _write_instances_and_yield_demonstrations(
    store: AttemptStore, folder: TaskFolder, draft: Path, episodes: list[dict[str, Any]]
) -> Iterator[Demonstration]:
    """Yield the demonstrations, write the instance of each, and append its description to ``episodes``.

    An arm's file is named relative to the data set, which has a copy of it.
    """
    for number, kept in enumerate(store.demonstrations()):
        instance = make_robot_path_relative(TaskInstance.model_validate_json(kept.instance), folder.path)
        demonstration = replace(kept, instance=instance.model_dump_json())
        write_text(draft / "instances" / f"seed_{number}.json", demonstration.instance)
        episodes.append(
            {
                "episode": number,
                "attempt": demonstration.attempt,
                "base_seed": demonstration.base_seed,
                "instance_hash": demonstration.instance_hash,
                "language": demonstration.language,
                "steps": demonstration.steps,
                "strict_score": demonstration.strict,
            }
        )
        yield demonstration
