"""A data set: the demonstrations of a working folder in one of the formats, with what they are."""

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
from grs_agents.sim.instance.robot_file import make_robot_path_relative
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
    """Refuse, before anything is simulated, what could not be written. Raises ``ConfigError``: a package is missing;
    ``InputError``: pictures of such a size cannot be a film."""
    for package in _PACKAGES[kind]:
        try:
            importlib.import_module(package)
        except ImportError as error:
            extra = f'run: pip install "grs-agents[{_EXTRAS[kind]}]"'
            raise ConfigError(f"{package}, which --format {kind} needs, is not installed", extra) from error
    if kind == "lerobot" and order.cameras and any(side % 2 for side in order.size):
        size = f"{order.size[0]}x{order.size[1]}"
        raise InputError(f"pictures of {size}: a film has an even number of rows and columns", "use e.g. --size 96x128")


def write_dataset(made: AttemptStore, kind: Format, out: Path, folder: TaskFolder) -> DatasetSummary:
    """Write a data set to ``out``, whole or not at all, and remove the working folder.

    ``out`` is a task folder too: ``instances/seed_<N>.json`` is what episode N began in. ``grs.json`` says what the
    episodes and cameras are. Raises ``GrsError``: no attempt gave a demonstration.
    """
    dropped = made.read_dropped_attempts()
    counted = Counter(f"{one.stage}: {one.why}" for one in dropped).most_common(_REASONS)
    reasons = tuple(f"{count} x {why}" for why, count in counted)
    first = next(made.demonstrations(), None)
    if first is None:
        found = f"none of {len(dropped)} attempts gave a demonstration: {'; '.join(reasons)}"
        shutil.rmtree(made.path)
        raise GrsError(found, "vary less")
    card, draft = _make_card(first, made, kind, out, folder), made.path / "dataset"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    episodes: list[dict[str, Any]] = []
    _WRITERS[kind](_write_instances_and_yield_demonstrations(made, folder, draft, episodes), card, draft)
    stages = dict(Counter(one.stage for one in dropped))
    told = {"format": kind, "dataset": card.model_dump(), "order": made.order, "dropped": stages, "episodes": episodes}
    write_json(draft / DATASET_FILE, told)
    folder.copy_assets_and_robot(draft)
    draft.rename(out)
    shutil.rmtree(made.path)
    steps = sum(int(one["steps"]) for one in episodes)
    return DatasetSummary(
        format=kind,
        out=str(out),
        episodes=len(episodes),
        steps=steps,
        dropped=stages,
        reasons=reasons,
        opens_with=_python_line_that_opens(kind, out, card),
    )


def _write_instances_and_yield_demonstrations(
    made: AttemptStore, folder: TaskFolder, draft: Path, episodes: list[dict[str, Any]]
) -> Iterator[Demonstration]:
    """The demonstrations; each one's instance is written, and what is to be said of it is added to ``episodes``.

    An arm's file is named relative to the data set, which has a copy of it.
    """
    for number, kept in enumerate(made.demonstrations()):
        instance = make_robot_path_relative(TaskInstance.model_validate_json(kept.instance), folder.path)
        one = replace(kept, instance=instance.model_dump_json())
        write_text(draft / "instances" / f"seed_{number}.json", one.instance)
        episodes.append(
            {
                "episode": number,
                "attempt": one.attempt,
                "base_seed": one.base_seed,
                "instance_hash": one.instance_hash,
                "language": one.language,
                "steps": one.steps,
                "strict_score": one.strict,
            }
        )
        yield one


def _make_card(first: Demonstration, made: AttemptStore, kind: Format, out: Path, folder: TaskFolder) -> DatasetCard:
    content = json.dumps([kind, made.order, made.count], sort_keys=True)
    return DatasetCard(
        name=folder.path.resolve().name,
        id=hashlib.sha256(content.encode()).hexdigest()[:32],
        folder=str(out.resolve()),
        robot=first.robot,
        rate=first.rate,
        joint_names=first.joint_names,
        object_names=first.object_names,
        cameras=first.cameras,
        versions=installed_versions(),
    )


def _python_line_that_opens(kind: Format, out: Path, card: DatasetCard) -> str:
    """A line of Python that opens the data set."""
    if kind == "lerobot":
        return f"LeRobotDataset({f'grs/{card.name}'!r}, root={str(out)!r})"
    if kind == "robomimic":
        return f"h5py.File({str(out / FILE)!r})"
    return f"minari.MinariDataset({str(out / minari_id(card) / 'data')!r})"
