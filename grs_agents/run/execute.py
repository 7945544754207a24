"""Run a graph on a scene: folder, checkpoints, resume, and an honest end whatever happens."""

import errno
import os
import sqlite3
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from grs_agents import content
from grs_agents.agents import Agents
from grs_agents.config import Config
from grs_agents.errors import GrsError
from grs_agents.files import unwritable
from grs_agents.nodes import Services
from grs_agents.policies import load_policy
from grs_agents.run.folder import new_folder, old_folder
from grs_agents.run.record import RunRecord, counts, seconds_by_stage, versions
from grs_agents.sandbox import Sandbox
from grs_agents.trace import EventLog, Note, RunEnded, RunStarted, read_events

PRELOAD = ("grs_agents.sim", "grs_agents.toolkit")
"""What a sandbox worker imports before it sees generated code."""
EXIT_STATUS = {"accepted": 0, "rejected": 1}
INTERRUPTED = 130
Views = Callable[[Path, EventLog], AbstractContextManager[None]]
"""Attaches what people look at (recording, progress) to the log of a run, and closes it at the end."""


@dataclass(frozen=True)
class Order:
    """What the user asked for.

    Attributes:
        command: ``run`` or ``scene``.
        source: the scene folder.
        config: the effective configuration.
        out: the run folder, if named.
        resume: go on with the run in ``out``.
    """

    command: str
    source: Path
    config: Config
    out: Path | None = None
    resume: bool = False


def execute(order: Order, views: Views) -> tuple[Path, RunRecord, GrsError | None]:
    """Run the configured graph on ``order.source``.

    Args:
        order: what to do.
        views: what follows the log.

    Returns:
        The run folder, its final record, and the user's error if there was one (the record then says ``failed``).

    Raises:
        InputError: the run folder itself cannot be made or resumed, or the configuration names what does not exist.
    """
    folder, record, config = _open(order)
    if order.resume and record.status in EXIT_STATUS:
        return folder, record, None
    record.write(folder)
    log = EventLog(folder / "events.jsonl")
    problem: GrsError | None = None
    state: dict[str, Any] = {}
    with log, views(folder, log):
        try:
            state = _invoke(order, config, folder, log, record)
            status, reason = state.get("status", "accepted"), state.get("reason", "the scene was comprehended")
            record = _ended(record, status, reason, EXIT_STATUS[status])
        except KeyboardInterrupt:
            record = _ended(record, "interrupted", "interrupted by the user", INTERRUPTED)
        except Exception as error:
            problem = _as_grs_error(error, folder)
            record = _ended(record, "failed", str(problem), problem.exit_status)
        record = _finished(record, log, state).write(folder)
    return folder, record, problem


def _ended(record: RunRecord, status: str, reason: str, exit_status: int) -> RunRecord:
    return record.model_copy(update={"status": status, "reason": reason, "exit_status": exit_status})


def _as_grs_error(error: Exception, folder: Path) -> GrsError:
    """The user's errors as they are, a full or read-only disk as one of them, anything else as ours."""
    if isinstance(error, GrsError):
        return error
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EACCES):
        return unwritable(folder, error)
    if isinstance(error, sqlite3.OperationalError) and "full" in str(error):
        return unwritable(folder / "checkpoint.sqlite", OSError(errno.ENOSPC, "disk is full"))
    problem = GrsError(f"{type(error).__name__}: {error}", f"report it with {folder / 'events.jsonl'}")
    problem.__cause__ = error
    return problem


def _open(order: Order) -> tuple[Path, RunRecord, Config]:
    if order.resume:
        folder, record = old_folder(order.out, order.source)
        config = Config.model_validate(record.config)
        if record.status in EXIT_STATUS:
            return folder, record, config
        update = {"status": "running", "reason": "", "exit_status": None, "attempts": record.attempts + 1}
        return folder, record.model_copy(update=update), config
    config = order.config
    content.path("graphs", config.graph)
    load_policy(config.policy)
    folder = new_folder(order.source.resolve().name, config.seed, order.out)
    record = RunRecord(
        id=folder.resolve().name,
        status="running",
        command=order.command,
        source=str(order.source),
        graph=config.graph,
        config=config.model_dump(mode="json"),
        versions=versions(),
        seeds=tuple(config.seed + step for step in range(config.audit.seeds)),
    )
    return folder, record, config


def _invoke(order: Order, config: Config, folder: Path, log: EventLog, record: RunRecord) -> dict[str, Any]:
    """Compile the graph with its checkpointer and run it, or go on with it."""
    os.environ.setdefault("LANGGRAPH_STRICT_MSGPACK", "true")  # a tampered checkpoint must not call functions on load
    from langgraph.checkpoint.sqlite import SqliteSaver

    checkpoints = str(folder / "checkpoint.sqlite")
    with Sandbox(preload=PRELOAD) as sandbox, SqliteSaver.from_conn_string(checkpoints) as saver:
        sandbox.warm()  # its imports overlap with comprehension
        services = _services(config, folder, log, sandbox)
        graph = content.load_module("graphs", config.graph).build().compile(checkpointer=saver)
        drawn = graph.get_graph()
        log.append(
            RunStarted(
                run_id=record.id,
                graph=config.graph,
                seed=config.seed,
                config=record.config,
                versions=record.versions,
                nodes=tuple(drawn.nodes),
                edges=tuple((edge.source, edge.target) for edge in drawn.edges),
            )
        )
        settings: dict[str, Any] = {
            "configurable": {"thread_id": record.id},
            "recursion_limit": 25 + 4 * config.max_fixes,
        }
        begin: dict[str, Any] | None = {
            "scene_path": str(order.source),
            "max_fixes": config.max_fixes,
            "fixes": 0,
            "history": [],
        }
        if order.resume and graph.get_state(settings).values:
            log.append(Note(level="info", text=f"resumed, attempt {record.attempts}"))
            begin = None
        return cast(dict[str, Any], graph.invoke(begin, settings, context=services, durability="sync"))


def _services(config: Config, folder: Path, log: EventLog, sandbox: Sandbox) -> Services:
    """What the nodes work with; every model is made now, so that a missing key ends the run before it begins."""
    agents = Agents(config=config, log=log, folder=folder)
    for role in config.models:
        agents.model(role)
    visits = Counter(event.node for event in read_events(log.path) if event.kind == "node_started")
    return Services(
        config=config,
        log=log,
        agents=agents,
        policy=load_policy(config.policy),
        sandbox=sandbox,
        folder=folder.resolve(),
        visits=visits,
    )


def _finished(record: RunRecord, log: EventLog, state: dict[str, Any]) -> RunRecord:
    history = read_events(log.path)
    update = {
        "counts": counts(history, state),
        "rewards": tuple(state.get("audit", {}).get("rewards", ())),
        "seconds": seconds_by_stage(history),
        "sandbox": str(state.get("report", {}).get("backend", "")),
    }
    try:
        log.append(RunEnded(status=record.status, reason=record.reason))
    except OSError as error:  # a full disk: the record still says how the run ended
        update["reason"] = f"{record.reason} (the event log could not be closed: {error.strerror})"
    return record.model_copy(update=update)
