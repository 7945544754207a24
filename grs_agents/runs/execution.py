"""Execution of a graph on a scene: checkpoints, resumption, and a record of every outcome."""

import errno
import sqlite3
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from langgraph.errors import GraphInterrupt
from langgraph.runtime import Runtime

from grs_agents.agents.agent import Agents
from grs_agents.agents.budget import BudgetReached
from grs_agents.audit.types import JudgedWords
from grs_agents.base import interrupts
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, GrsError, InputError, OutputError
from grs_agents.base.files import convert_system_error, unwritable_error
from grs_agents.base.foreign.files import path_exists
from grs_agents.base.questions import Question, parse_question
from grs_agents.base.trace.events import Event, NodeEnded, Note, RunEnded, RunStarted
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.earlier_judgements import forget_judgements
from grs_agents.graph.judging import conclude_with_best_version
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState, parse_state, state_as_json
from grs_agents.perception.edits import FILE as EDITS
from grs_agents.perception.edits import read_edits, write_edits
from grs_agents.runs.checkpoint import FILE, MOST_VALUE, RecordSerializer, check_checkpoint_file, check_restored_state
from grs_agents.runs.graph_loading import compile_graph, explain_graph_error
from grs_agents.runs.hashes import write_hashes
from grs_agents.runs.record import EXIT_STATUS, RunRecord, count_run_results, seconds_by_stage, sum_reply_costs
from grs_agents.runs.recording import add_recording_comparison, write_cassette
from grs_agents.runs.run_opening import RUNS, RunOrder, open_run, remove_run_folder
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sim.arms.mjcf_arm import recognise_own_hand
from grs_agents.sim.arms.registry import ROBOTS, get_arm

if TYPE_CHECKING:
    from langgraph.checkpoint.base import BaseCheckpointSaver

INTERRUPTED, WAITING = 130, 4
"""Exit statuses of runs without a verdict."""
_READING = {"read", "find_table", "segment"}
"""The nodes up to segmentation."""
_COUNTED = ("scene", "task", "audit", "report", "objects")
"""Keys of the state that the record's counts are made of."""
Views = Callable[[Path, EventLog], AbstractContextManager[None]]
"""Attaches views (recording, progress) to the log of a run and closes them at its end."""
State = dict[str, Any]


class UnexpectedError(GrsError):
    """An internal error of GRS, with its cause."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    folder: Path
    record: RunRecord
    problem: GrsError | None = None  # the error that ended a `failed` run
    state: State = field(default_factory=dict[str, Any])  # of the graph; empty if an ended run was resumed


def execute_run(order: RunOrder, views: Views) -> Outcome:
    """Run the configured graph on a scene. A refused scene leaves no folder; its record is returned with the reason.

    Raises:
        InputError: scene, configuration or folder is refused before the run begins.
    """
    place = order.out or RUNS
    missing = [path for path in (place, *place.parents) if not path_exists(path)]
    with open_run(order) as (folder, record, config):
        if order.resume and record.status != "running":
            return Outcome(folder, record)
        ended = _execute_with_log(order, views, folder, record.write(folder), config)
        # A scene refused before anything was segmented leaves nothing to look at.
        if not order.resume and isinstance(ended.problem, InputError) and not isinstance(ended.problem, OutputError):
            events = read_events(folder / "events.jsonl")
            started = {event.node for event in events if event.kind == "node_started"}
            segmented = any(event.kind == "scene_stage" and event.stage == "segmented" for event in events)
            if started and started <= _READING and not segmented:
                remove_run_folder(folder, missing if order.out else [folder, *missing])
        return ended


def _execute_with_log(order: RunOrder, views: Views, folder: Path, record: RunRecord, config: Config) -> Outcome:
    problem: GrsError | None = None
    state: State = {}
    try:
        with EventLog(folder / "events.jsonl") as log, views(folder, log):
            log.subscribe(_raise_interrupt_at_node_start)
            ended, failure = record, None  # `record` stays running until run.json holds the outcome
            try:
                question = _invoke_graph(order, config, folder, log, record, state)
                if question is not None:
                    ended = _mark_record_waiting(record, question)
                else:
                    ended = _mark_record_with_verdict(order, record, state)
                    if config.cassette and not config.record:
                        ended = add_recording_comparison(config.cassette, ended, folder)
            except GraphInterrupt as interrupt:  # for the surrounding graph, which keeps the checkpoints
                waiting = _mark_record_waiting(record, parse_question(interrupt.args[0][0].value))
                _add_metrics_to_record(waiting, log, state).write(folder)
                raise
            except (Exception, KeyboardInterrupt) as error:
                ended, failure = _mark_record_failed(ended, error, folder)
            record, problem = _add_metrics_to_record(ended, log, state).write(folder), failure
            if config.record:
                write_cassette(Path(config.record), config, record, folder)
    except GraphInterrupt:
        raise
    except (Exception, KeyboardInterrupt) as error:  # the log or a view could not be opened or closed
        if record.status == "running":
            record, problem = _mark_record_failed(record, error, folder)
            record.write(folder)
        elif problem is None:  # the verdict stands
            problem = _convert_to_grs_error(error, folder, record.graph)
    if record.status in EXIT_STATUS:
        try:
            write_hashes(folder)  # of the recording too, which is whole now
        except (Exception, KeyboardInterrupt) as error:
            problem = problem or _convert_to_grs_error(error, folder, record.graph)
    return Outcome(folder, record, problem, state)


def _raise_interrupt_at_node_start(event: Event) -> None:
    """Stop an interrupted run at its next node, even if the exception of the interruption was lost."""
    if event.kind == "node_started" and interrupts.is_interrupt_requested():
        raise KeyboardInterrupt


@contextmanager
def _open_warming_sandbox(order: RunOrder, config: Config, folder: Path, log: EventLog) -> Generator[Sandbox]:
    """A sandbox whose imports overlap with comprehension: they begin once the first node, which may refuse the photo,
    has ended. Its workers may read the assets that the run will write."""
    assets = folder.resolve() / "assets"

    def warm_up(event: Event) -> None:
        if isinstance(event, NodeEnded) and not event.error:
            assets.mkdir(exist_ok=True)
            sandbox.warm_up([assets])

    with open_sandbox(config) as sandbox:
        if order.command == "run":  # `scene` calls no generated code
            log.subscribe(warm_up)
        try:
            yield sandbox
        finally:
            with suppress(OSError):  # it holds assets
                assets.rmdir()


def _mark_record_with_verdict(order: RunOrder, record: RunRecord, state: State) -> RunRecord:
    """The graph's verdict; comprehension alone has none."""
    if order.command == "scene" and not state.get("problem"):
        return _mark_record_ended(record, "accepted", "the scene was comprehended", EXIT_STATUS["accepted"])
    status = state.get("status")
    if status not in EXIT_STATUS:
        raise ConfigError(
            f"graph {record.graph!r} ended without a verdict (status {status!r})",
            f"end it with the node conclude, or set status to {' or '.join(EXIT_STATUS)}",
        )
    return _mark_record_ended(record, status, str(state.get("reason", "")), EXIT_STATUS[status])


def _mark_record_ended(record: RunRecord, status: str, reason: str, exit_status: int) -> RunRecord:
    return record.model_copy(update={"status": status, "reason": reason, "exit_status": exit_status})


def _mark_record_waiting(record: RunRecord, question: Question) -> RunRecord:
    return _mark_record_ended(record, "waiting", question.text, WAITING).model_copy(update={"question": question})


def _mark_record_failed(
    record: RunRecord, error: Exception | KeyboardInterrupt, folder: Path
) -> tuple[RunRecord, GrsError | None]:
    """Returns: record of an interrupted or failed run; the error of a failed run."""
    if isinstance(error, KeyboardInterrupt):
        return _mark_record_ended(record, "interrupted", "interrupted by the user", INTERRUPTED), None
    problem = _convert_to_grs_error(error, folder, record.graph)
    return _mark_record_ended(record, "failed", str(problem), problem.exit_status), problem


def _convert_to_grs_error(error: Exception | KeyboardInterrupt, folder: Path, graph: str) -> GrsError:
    """Convert file system errors and errors of user code to errors of the user, any other error to an internal
    error."""
    if isinstance(error, GrsError):
        return error
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EACCES):
        return unwritable_error(folder, error)
    if isinstance(error, OSError) and (refused := convert_system_error(error)):
        return refused
    if isinstance(error, sqlite3.OperationalError) and "full" in str(error):
        return unwritable_error(folder / FILE, OSError(errno.ENOSPC, "disk is full"))
    explained = None if isinstance(error, KeyboardInterrupt) else explain_graph_error(error, graph, __file__)
    unexpected = UnexpectedError(f"{type(error).__name__}: {error}", f"report it with {folder / 'events.jsonl'}")
    problem = explained or unexpected
    problem.__cause__ = error
    return problem


def _describe_robot_file(robot: str, hand: str) -> list[str]:
    arm = get_arm(robot, hand)
    lines = [f"arm: {arm.dof} joints, reaches {arm.describe_reach()}"]
    try:
        return [*lines, str(recognise_own_hand(Path(robot)))]
    except InputError as error:
        return [*lines, error.message]


def _invoke_graph(
    order: RunOrder, config: Config, folder: Path, log: EventLog, record: RunRecord, state: State
) -> Question | None:
    """Compile the graph and run or resume it; ``state`` receives its final state.

    Returns:
        The question of a waiting run, the first of several; None once the graph has ended.
    """
    with (
        _open_warming_sandbox(order, config, folder, log) as sandbox,
        _open_checkpointer(order, folder) as checkpointer,
    ):
        services = Services(
            config=config,
            log=log,
            agents=Agents.resume_from_log(config, log, folder),
            policy=load_policy(config.policy),
            sandbox=sandbox,
            folder=folder.resolve(),
            recorded_source=order.recorded_source,
            visits=Counter(event.node for event in read_events(log.path) if event.kind == "node_started"),
        )
        forget_judgements(services)  # the folder may be foreign: this process judges anew
        graph = compile_graph(config.graph, checkpointer)
        topology = graph.get_graph()
        log.append(
            RunStarted(
                run_id=record.id,
                graph=config.graph,
                seed=config.seed,
                config=record.config.as_json(),
                versions=record.versions,
                nodes=tuple(topology.nodes),
                edges=tuple((edge.source, edge.target) for edge in topology.edges),
            )
        )
        if services.robot_name_or_path not in ROBOTS:
            for line in _describe_robot_file(services.robot_name_or_path, config.hand):
                log.append(Note(level="info", text=line))
        settings: dict[str, Any] = {"recursion_limit": config.recursion_limit or 25 + 4 * config.max_fixes}
        if order.callbacks:
            settings["callbacks"] = list(order.callbacks)
        initial: State = {"scene_path": str(order.source), "max_fixes": config.max_fixes, "fixes": 0, "history": []}
        initial = {**parse_state(order.given), **_read_or_keep_edits(order, folder), **initial}
        try:
            if order.nested:
                state.update(graph.invoke(initial, settings, context=services))
                return None
            settings["configurable"] = {"thread_id": record.id}
            resumed = order.resume and bool(_load_checkpoint_state(graph, settings, folder, order.source))
            if resumed:
                log.append(Note(level="info", text=f"resumed, attempt {record.attempts}"))
            try:
                start = _command_with_reply(graph, settings, order, log) if resumed else initial
                graph.invoke(start, settings, context=services, durability="sync")
            finally:
                with suppress(sqlite3.Error):  # a full disk is reported by the error that it caused
                    state.update(graph.get_state(settings).values)
            questions = graph.get_state(settings).interrupts
            return parse_question(questions[0].value) if questions else None
        except BudgetReached as reached:
            state["problem"] = reached.message
            state.update(conclude_with_best_version(cast(RunState, state), runtime=Runtime(context=services)))
    return None


def _read_or_keep_edits(order: RunOrder, folder: Path) -> State:
    """The edits of the scene that the order gives, which are kept in the folder, or that an earlier attempt kept.

    Raises:
        InputError: an earlier attempt had other edits.
    """
    state, file = parse_state(order.given), folder / EDITS
    kept = read_edits(file) if order.resume and path_exists(file) else None
    if "edits" not in state:
        return {} if kept is None else {"edits": kept}
    given = state["edits"]
    if order.resume and given != kept:
        raise InputError(f"{folder} was begun with other edits than these", "run the scene again in another folder")
    if kept is None:
        write_edits(given, file)
    return {"edits": given}


def _command_with_reply(graph: Any, settings: dict[str, Any], order: RunOrder, log: EventLog) -> Any:
    """The command that resumes a graph with the reply to its first question; None without question or reply."""
    from langgraph.types import Command

    questions = graph.get_state(settings).interrupts
    if not questions or order.reply is None:
        return None
    log.append(Note(level="info", text=f"{parse_question(questions[0].value).text} {order.reply}"))
    return Command(resume={questions[0].id: order.reply})


def _load_checkpoint_state(graph: Any, settings: dict[str, Any], folder: Path, source: Path) -> State:
    """The state of an earlier attempt."""
    try:
        values: State = graph.get_state(settings).values
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, sqlite3.Error) as error:
        raise InputError(
            f"{folder / FILE} holds no readable checkpoint: {type(error).__name__}: {error}",
            "start the scene again in another folder: --out",
        ) from error
    check_restored_state(values, folder)
    if values and Path(str(values.get("scene_path"))).resolve() != source.resolve():
        raise InputError(
            f"{folder / FILE} is of the scene {str(values.get('scene_path'))[:200]!r}, not of {source}",
            "start the scene again in another folder: --out",
        )
    return values


@contextmanager
def _open_checkpointer(order: RunOrder, folder: Path) -> Generator["BaseCheckpointSaver[str] | None"]:
    """The checkpointer of the run; None for a nested graph, whose checkpoints belong to the surrounding graph."""
    from langgraph.checkpoint.sqlite import SqliteSaver

    if order.nested:
        yield None
        return
    check_checkpoint_file(folder)
    with closing(sqlite3.connect(folder / FILE, check_same_thread=False)) as connection:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_VALUE)
        yield SqliteSaver(connection, serde=RecordSerializer())


def _add_metrics_to_record(record: RunRecord, log: EventLog, state: State) -> RunRecord:
    """The record with its metrics; an unreadable log or state leaves them out."""
    history: list[Event] = []
    update: dict[str, Any] = {}
    with suppress(GrsError):
        history = read_events(log.path)
    with suppress(KeyError, TypeError, AttributeError, ValueError):  # the state of a user's graph may lack them
        reached = state_as_json({key: state[key] for key in _COUNTED if key in state})
        update = {
            "counts": count_run_results(history, reached),
            "rewards": tuple(reached.get("audit", {}).get("rewards", ())),
            "edits": tuple(reached.get("scene", {}).get("edits", ())),
            "sentence": str(reached.get("audit", {}).get("sentence", "")),
            "words": None if (words := reached.get("audit", {}).get("words")) is None else JudgedWords(**words),
            "sandbox": str(reached.get("report", {}).get("backend", "")),
        }
    update |= {"seconds": seconds_by_stage(history), "cost": sum_reply_costs(history)}
    try:
        log.append(RunEnded(status=record.status, reason=record.reason))
    except (OSError, GrsError) as error:  # a full disk: the record still says how the run ended
        update["reason"] = f"{record.reason} (the event log could not be closed: {error})"
    return record.model_copy(update=update)
