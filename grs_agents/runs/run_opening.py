"""Opening of a run: validate the request before anything runs, then create its folder or open it to resume."""

import fcntl
import os
import re
import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grs_agents.agents.recorded import read_cassette
from grs_agents.base import content
from grs_agents.base.config.load import EffectiveConfig, change_config
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.base.files import check_output_path, unwritable_error
from grs_agents.base.foreign.files import path_exists
from grs_agents.base.questions import require_reply_is_a_choice
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.models.factory import make_chat_model
from grs_agents.perception.reading.foreign_scene import is_sample_scene
from grs_agents.perception.reading.scene_source import check_scene_source, short_scene_name
from grs_agents.runs.checkpoint import FILE as CHECKPOINT
from grs_agents.runs.graph_loading import compile_graph, load_graph
from grs_agents.runs.record import EXIT_STATUS, FILE, RunRecord, installed_versions, read_record
from grs_agents.sim.arms.mjcf_arm import recognise_own_hand
from grs_agents.sim.arms.registry import ROBOTS
from grs_agents.sim.hands.registry import OWN_HAND
from grs_agents.toolkit import load_tool

if TYPE_CHECKING:
    from langchain_core.callbacks import BaseCallbackHandler

RUNS = Path("runs")
"""Parent of the run folders that the user does not name."""
LOCK = ".lock"
"""Lock file with the id of the process that runs in the folder."""


def make_run_folder(name: str, seed: int, out: Path | None) -> Path:
    """Create the folder of a new run: ``out``, or ``runs/<time>-<name>-<seed>``."""
    if out is not None:
        require_unused_folder(out)
        return _make_folder(out, exist_ok=True)
    slug = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-") or "scene"
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    base = folder = RUNS / f"{stamp}-{slug}-{seed}"
    number = 1
    while True:
        try:
            return _make_folder(folder, exist_ok=False)
        except FileExistsError:
            number += 1
            folder = base.with_name(f"{base.name}-{number}")


def remove_run_folder(folder: Path, created: Sequence[Path]) -> None:
    """Empty a run's folder, then remove the folders ``created`` for it, innermost first, if empty."""
    for entry in folder.iterdir():
        shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()
    for path in created:
        with suppress(OSError):  # another run may use it by now
            path.rmdir()


def _make_folder(folder: Path, exist_ok: bool) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=exist_ok)
    except FileExistsError as error:
        if not exist_ok:
            raise
        raise unwritable_error(folder, error) from error
    except OSError as error:
        raise unwritable_error(folder, error) from error
    return folder


def require_unused_folder(folder: Path) -> None:
    """Raise InputError unless a folder is new or empty."""
    if (folder / FILE).exists():
        raise InputError(f"{folder} already holds a run", "go on with it with --resume, or name another with --out")
    try:
        if folder.is_dir() and any(entry.name != LOCK for entry in folder.iterdir()):
            raise InputError(f"{folder} is not empty", "name a new or empty folder with --out")
    except OSError as error:
        raise unwritable_error(folder, error) from error


@contextmanager
def lock_run_folder(folder: Path) -> Generator[None]:
    """Lock ``folder`` against other runs within the context; the kernel releases the lock of a killed process.

    Readers need no lock.
    """
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise unwritable_error(folder / LOCK, error) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        except BlockingIOError as error:
            holder = os.pread(descriptor, 20, 0)
            owner = f"process {int(holder)}" if holder.isdigit() else "another process"
            raise InputError(f"{folder} is in use by {owner}", "wait until it ends, or name another --out") from error
        except OSError as error:
            raise unwritable_error(folder / LOCK, error) from error
        yield
    finally:
        os.close(descriptor)


def open_resumed_folder(out: Path | None, source: Path, command: str) -> tuple[Path, RunRecord]:
    """Open the folder of an earlier run of the same scene and ``command``."""
    if out is None:
        raise InputError("--resume needs the folder of the run", "name it with --out DIR")
    record = read_record(out)
    if Path(record.source).resolve() != source.resolve():
        raise InputError(
            f"{out} is a run of {record.source}, not of {source}", "resume it with the scene it was made from"
        )
    if record.command != command:
        raise InputError(
            f"{out} was made by `grs {record.command}`, not by `grs {command}`", "name another folder with --out"
        )
    return out, record


def find_recorded_scene(folder: Path) -> Path:
    """The scene of an earlier run, by its record.

    Raises:
        InputError: the run would begin anew, with a photo that the folder alone chooses.
    """
    record = read_record(folder)
    source = Path(record.source)
    if record.status not in EXIT_STATUS and not is_sample_scene(source) and not (folder / CHECKPOINT).is_file():
        raise InputError(f"{folder} holds no {CHECKPOINT} to go on from", "name the scene, which then begins anew")
    return source


GIVEN = frozenset({"scene_path", "max_fixes", "fixes", "history"})
"""State fields that every run begins with."""


@dataclass(frozen=True)
class RunOrder:
    """A user's request for a run."""

    command: str  # `run` or `scene`
    source: Path  # the scene: a folder, a file, or `bop:` and an image of a data set
    config: EffectiveConfig  # of this machine; a resumed run takes its portable settings from its record
    out: Path | None = None
    resume: bool = False  # go on with the run in `out`
    # fields of the state beside those that every run begins with
    given: Mapping[str, Any] = field(default_factory=dict[str, Any])
    reply: str | None = None  # to the question of the waiting run in `out`
    recorded_source: bool = False  # the record in `out` names the source, and the user does not
    nested: bool = False  # the graph runs in a node of a surrounding graph, which keeps the checkpoints
    callbacks: tuple["BaseCallbackHandler", ...] = ()  # LangChain's, of the graph and of the calls of models in it


@contextmanager
def open_run(order: RunOrder) -> Generator[tuple[Path, RunRecord, Config]]:
    """Validate the order, create or open the run's folder, and lock it within the context.

    Yields:
        The folder, the record to write into it (of an ended run: its own record), the configuration.
    """
    if order.resume:
        folder, record = open_resumed_folder(order.out, order.source, order.command)
        if record.status in EXIT_STATUS or (record.status == "waiting" and order.reply is None and not order.nested):
            yield folder, record, order.config.config
            return
        if order.reply is not None:
            if record.question is None:
                raise InputError(f"the run {order.out} is {record.status} and waits for no reply", "see `grs show`")
            if not order.nested and not (folder / CHECKPOINT).is_file():
                # Without a checkpoint it would restart, with a scene chosen by the folder.
                raise InputError(
                    f"{order.out} holds no {CHECKPOINT} to go on from", "run the scene again in another folder: --out"
                )
            require_reply_is_a_choice(record.question, order.reply)
        with lock_run_folder(folder):
            record = read_record(folder)  # another process may have changed it before it released the lock
            config = record.config.resume_on(order.config)
            require_configured_names_exist(config, order.command, order.given)
            if record.status not in EXIT_STATUS:
                update = {
                    "config": RecordedConfig.of(config),
                    "status": "running",
                    "reason": "",
                    "exit_status": None,
                    "question": None,
                    "attempts": record.attempts + 1,
                }
                record = record.model_copy(update=update)
            yield folder, record, config
        return
    check_scene_source(order.source)
    config = _prefer_own_hand(order.config)
    require_configured_names_exist(config, order.command, order.given)
    folder = make_run_folder(short_scene_name(order.source), config.seed, order.out)
    record = RunRecord(
        id=folder.resolve().name,
        status="running",
        command=order.command,
        source=str(order.source),
        graph=config.graph,
        config=RecordedConfig.of(config),
        versions=installed_versions(),
        seeds=tuple(config.seed + step for step in range(config.audit.seeds)),
    )
    with lock_run_folder(folder):
        require_unused_folder(folder)  # another process may have been faster
        yield folder, record, config


def _prefer_own_hand(chosen: EffectiveConfig) -> Config:
    """The configuration, with the hand of the robot's own file if it is recognised and none is named."""
    config = chosen.config
    if chosen.sources.get("hand", "default") != "default" or config.robot in ROBOTS:
        return config
    try:
        if config.own_hand is None:
            recognise_own_hand(Path(config.robot).resolve())
    except InputError:  # the run notes the reason
        return config
    return change_config(config, hand=OWN_HAND)


def require_configured_names_exist(config: Config, command: str, given: Mapping[str, Any]) -> None:
    """Raise ConfigError or InputError if a graph, policy, tool, prompt, cassette or model of ``config`` cannot be
    loaded."""
    graph = load_graph(config.graph)
    needs: Sequence[str] = getattr(graph, "NEEDS", ())
    missing = [name for name in needs if name not in GIVEN and name not in given]
    if missing:
        raise ConfigError(
            f"graph {config.graph!r} needs {' and '.join(missing)} in its state, and a run begins with a photo alone",
            "use graph=grs, or call the graph from your own program",
        )
    if command == "run" and not getattr(graph, "VERDICT", True):
        raise ConfigError(f"graph {config.graph!r} comes to no verdict", "use graph=grs, or `grs scene` for the scene")
    compile_graph(config.graph)
    load_policy(config.policy)
    for name in config.tools.model_dump().values():
        load_tool(name)
    for name in config.prompts.model_dump().values():
        content.content_path("prompts", name)
    if config.record:
        check_output_path(Path(config.record))
        if path_exists(Path(config.record)):
            read_cassette(config.record)  # only a cassette may be overwritten
    if config.cassette:
        read_cassette(config.cassette)
    for spec in config.models.values() if config.record or not config.cassette else ():
        make_chat_model(spec, config.seed)
