"""However a run ends, its record says how: verdicts, errors of all kinds, interruption, and what follows it."""

import errno
import os
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from grs_agents.base import content
from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, GrsError, InputError, OutputError
from grs_agents.base.trace.events import RunEnded, RunStarted
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.runs.execution import Outcome, UnexpectedError, execute_run
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder
from tests.kept_sandbox import lend_sandbox

GRAPH = """\
\"\"\"Two nodes: the first makes a note, the second does what the test is about.\"\"\"

from langgraph.graph import END, START, StateGraph

from grs_agents.base.errors import GrsError, InputError
from grs_agents.graph import Services
from grs_agents.graph.services import logged_node
from grs_agents.graph.state import RunState


@logged_node("first")
def first(state, services):
    return {{"notes": ["the first node was here"]}}


@logged_node("second")
def second(state, services):
    {body}


def build():
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("first", first)
    graph.add_node("second", second)
    graph.add_edge(START, "first")
    graph.add_edge("first", "second")
    graph.add_edge("second", {then})
    return graph
"""
ACCEPTED = 'return {"status": "accepted", "reason": "it holds"}'
Run = Callable[..., Outcome]


def silent(folder: Path, log: EventLog) -> AbstractContextManager[None]:
    """No views."""
    return nullcontext()


@pytest.fixture
def run(tmp_path: Path, sample_scene: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a graph whose second node has the given body; without one, the graph that is there."""
    monkeypatch.setattr(content, "_overlays", [])
    monkeypatch.setattr("grs_agents.runs.execution.open_sandbox", lend_sandbox)
    (tmp_path / "graphs").mkdir()
    content.add_overlay_folder(tmp_path)

    def execute_it(
        body: str = "",
        then: str = "END",
        views: Any = silent,
        resume: bool = False,
        reply: str | None = None,
        **settings: Any,
    ) -> Outcome:
        if body:
            (tmp_path / "graphs" / "mine.py").write_text(GRAPH.format(body=body, then=then))
        config = EffectiveConfig(Config(graph="mine", **settings))
        return execute_run(RunOrder("run", sample_scene, config, tmp_path / "run", resume=resume, reply=reply), views)

    return execute_it


def ends(folder: Path) -> list[str]:
    """The status of each end in the log."""
    return [event.status for event in read_events(folder / "events.jsonl") if isinstance(event, RunEnded)]


def nodes(folder: Path) -> list[str]:
    """The nodes that were left, with or without an error."""
    return [event.node for event in read_events(folder / "events.jsonl") if event.kind == "node_ended"]


@pytest.mark.parametrize(("status", "exit_status"), [("accepted", 0), ("rejected", 1)])
def test_a_verdict_of_the_graph_is_the_records(run: Run, status: str, exit_status: int) -> None:
    outcome = run(f'return {{"status": "{status}", "reason": "so it is"}}', seed=5)
    record = outcome.record
    assert (record.status, record.reason, record.exit_status) == (status, "so it is", exit_status)
    assert (record.seeds, record.attempts, record.graph) == ((5, 6, 7), 1, "mine")
    assert outcome.problem is None
    assert read_record(outcome.folder) == record
    assert ends(outcome.folder) == [status]
    assert set(record.seconds) == {"first", "second", "total"}
    [begin] = [event for event in read_events(outcome.folder / "events.jsonl") if isinstance(event, RunStarted)]
    assert ("first", "second") in begin.edges


def test_a_graph_without_a_verdict_is_the_users_fault(run: Run) -> None:
    outcome = run("return {}")
    assert isinstance(outcome.problem, ConfigError)
    assert (outcome.record.status, outcome.record.exit_status) == ("failed", 2)
    assert "'mine'" in outcome.record.reason and "verdict" in outcome.record.reason
    assert read_record(outcome.folder) == outcome.record


@pytest.mark.parametrize(
    ("body", "kind", "exit_status", "told"),
    [
        ("raise GrsError('the provider answers 401', 'check the key')", GrsError, 3, "401; check the key"),
        ("raise InputError('depth.png is no picture', 'give a PNG file')", InputError, 2, "depth.png is no picture"),
        (f"raise OSError({errno.ENOSPC}, '{os.strerror(errno.ENOSPC)}')", OutputError, 2, "No space left on device"),
    ],
    ids=["a provider's", "the user's", "a full disk"],
)
def test_an_exception_in_a_node_becomes_the_record(
    run: Run, body: str, kind: type[GrsError], exit_status: int, told: str
) -> None:
    outcome = run(body)
    record = outcome.record
    assert type(outcome.problem) is kind
    assert (record.status, record.exit_status) == ("failed", exit_status)
    assert told in record.reason and "\n" not in record.reason
    assert read_record(outcome.folder) == record
    assert ends(outcome.folder) == ["failed"]
    assert nodes(outcome.folder) == ["first", "second"]
    assert outcome.state["notes"] == ["the first node was here"]


def test_what_nobody_foresaw_keeps_its_cause_and_says_what_to_send(run: Run) -> None:
    with patch("grs_agents.runs.execution.load_policy", side_effect=ValueError("no such luck")):
        outcome = run(ACCEPTED)
    assert isinstance(outcome.problem, UnexpectedError) and isinstance(outcome.problem.__cause__, ValueError)
    assert (outcome.record.status, outcome.record.exit_status) == ("failed", 3)
    assert all(part in outcome.record.reason for part in ("ValueError: no such luck", "events.jsonl"))


def test_a_graph_that_never_ends_is_stopped(run: Run) -> None:
    outcome = run("return {}", then='"first"', max_fixes=0)
    assert (outcome.record.status, outcome.record.exit_status) == ("failed", 2)
    assert "did not end within 25 steps" in outcome.record.reason


def test_the_limit_of_steps_is_a_setting(run: Run) -> None:
    outcome = run("return {}", then='"first"', recursion_limit=7)
    assert "mine.py) did not end within 7 steps; end its loop, or" in outcome.record.reason
    assert "recursion_limit=N" in outcome.record.reason


WAITS = """\
if not (services.folder.parent / "go").exists():
        raise {error}
    return {{"status": "accepted", "reason": "it holds"}}"""


@pytest.mark.parametrize(
    ("error", "status", "exit_status"),
    [("KeyboardInterrupt", "interrupted", 130), ("ValueError('no such luck')", "failed", 2)],
)
def test_what_was_interrupted_or_broke_goes_on_at_the_node_where_it_stopped(
    run: Run, tmp_path: Path, error: str, status: str, exit_status: int
) -> None:
    stopped = run(WAITS.format(error=error))
    assert (stopped.record.status, stopped.record.exit_status) == (status, exit_status)
    assert read_record(stopped.folder) == stopped.record
    assert (stopped.problem is None) == (status == "interrupted")
    (tmp_path / "go").touch()
    resumed = run(resume=True)
    assert (resumed.record.status, resumed.record.attempts, resumed.record.reason) == ("accepted", 2, "it holds")
    assert resumed.problem is None
    assert nodes(resumed.folder) == ["first", "second", "second"]
    assert ends(resumed.folder) == [status, "accepted"]


def test_an_ended_run_is_not_run_again(run: Run) -> None:
    first = run(ACCEPTED)
    log = (first.folder / "events.jsonl").read_bytes()
    again = run("raise ValueError('not again')", resume=True)
    assert again.record == first.record
    assert (first.folder / "events.jsonl").read_bytes() == log


@contextmanager
def opens_never(folder: Path, log: EventLog) -> Generator[None]:
    """A view that cannot be opened."""
    raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(folder / "trace.rrd"))
    yield


@contextmanager
def closes_never(folder: Path, log: EventLog) -> Generator[None]:
    """A view that cannot be closed."""
    yield
    raise RuntimeError("the recording is torn")


def test_a_view_that_cannot_be_opened_fails_the_run(run: Run) -> None:
    outcome = run(ACCEPTED, views=opens_never)
    assert isinstance(outcome.problem, InputError)
    assert (outcome.record.status, outcome.record.exit_status) == ("failed", 2)
    assert "Permission denied" in outcome.record.reason
    assert read_record(outcome.folder) == outcome.record
    assert not nodes(outcome.folder)


def test_a_view_that_cannot_be_closed_leaves_the_verdict(run: Run) -> None:
    outcome = run(ACCEPTED, views=closes_never)
    assert (outcome.record.status, outcome.record.exit_status) == ("accepted", 0)
    assert "the recording is torn" in str(outcome.problem)
    assert read_record(outcome.folder) == outcome.record


@pytest.mark.parametrize(
    "settings", [{"policy": "rule"}, {"models": {"default": {"model": "nobody:any"}}}, {"tools": {"match": "nothing"}}]
)
def test_a_name_that_nothing_has_is_refused_before_a_folder_is_made(
    run: Run, tmp_path: Path, settings: dict[str, Any]
) -> None:
    with pytest.raises(ConfigError):
        run(ACCEPTED, **settings)
    assert not (tmp_path / "run").exists()


ASKING = """\
    from grs_agents.base.questions import ask_person
    reply = ask_person("Is the table right?", ("yes", "no"), "eleven objects")
    return {"status": "accepted" if reply == "yes" else "rejected", "reason": f"a person said {reply}"}
"""


def test_a_run_waits_for_a_person_and_goes_on_with_the_reply(run: Run) -> None:
    asked = run(ASKING.strip())
    assert (asked.record.status, asked.record.exit_status) == ("waiting", 4)
    assert asked.record.question is not None and asked.record.question.choices == ("yes", "no")
    assert "asks: Is the table right?" in str(read_events(asked.folder / "events.jsonl"))
    assert run(resume=True).record.status == "waiting"  # nobody has replied
    ended = run(resume=True, reply="yes")
    assert (ended.record.status, ended.record.reason) == ("accepted", "a person said yes")
    assert ended.record.question is None
    starts = [event.node for event in read_events(ended.folder / "events.jsonl") if event.kind == "node_started"]
    assert starts == ["first", "second", "second"]


def test_a_plain_interrupt_waits_too(run: Run) -> None:
    body = "from langgraph.types import interrupt\n    return {'status': 'accepted', 'reason': interrupt({'ask': 3})}"
    assert run(body).record.reason == '{"ask": 3}'
    assert run(resume=True, reply="any words").record.reason == "any words"


def test_a_reply_that_was_not_offered_leaves_the_run_waiting(run: Run, tmp_path: Path) -> None:
    run(ASKING.strip())
    with pytest.raises(InputError, match="'perhaps' begins with none of the choices; begin it with yes or no"):
        run(resume=True, reply="perhaps")
    assert read_record(tmp_path / "run").status == "waiting"


def test_a_run_that_asks_nothing_takes_no_reply(run: Run) -> None:
    run("raise KeyboardInterrupt")
    with pytest.raises(InputError, match="interrupted and waits for no reply"):
        run(resume=True, reply="yes")
