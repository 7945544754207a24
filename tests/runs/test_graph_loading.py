"""Graphs of the user's own: coroutine functions run, and a graph that is wrong is told in one line with its file."""

import asyncio
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from grs_agents.base import content
from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError
from grs_agents.runs.execution import Outcome, execute_run
from grs_agents.runs.graph_loading import compile_graph
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder
from tests.kept_sandbox import lend_sandbox

HEAD = """\
import asyncio
from langgraph.graph import END, START, StateGraph
from langgraph.types import Command, interrupt
from grs_agents.graph import Services, empty_graph, fix_code, generate_sim
from grs_agents.graph.state import RunState


def note(state: RunState):
    return {"notes": ["noted"]}


def accept(state: RunState):
    return {"status": "accepted", "reason": " ".join(state["notes"])}
"""
Run = Callable[..., Outcome]


@pytest.fixture
def run(tmp_path: Path, sample_scene: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the graph whose ``build()`` and nodes are given; without them, goes on with the run that is there."""
    monkeypatch.setattr(content, "_overlays", [])
    monkeypatch.setattr("grs_agents.runs.execution.open_sandbox", lend_sandbox)
    (tmp_path / "graphs").mkdir()
    content.add_overlay_folder(tmp_path)

    def run_graph(body: str = "", reply: str | None = None) -> Outcome:
        if body:
            (tmp_path / "graphs" / "mine.py").write_text(HEAD + body)
        order = RunOrder(
            "run", sample_scene, EffectiveConfig(Config(graph="mine")), tmp_path / "run", resume=not body, reply=reply
        )
        return execute_run(order, lambda folder, log: nullcontext())

    return run_graph


ASYNC_NODE = """
async def look(state: RunState):
    await asyncio.sleep(0)
    return {"notes": ["looked"]}


def build():
    graph = empty_graph().add_sequence([look, accept])
    graph.add_edge(START, "look")
    return graph
"""
ASYNC_BESIDE_ANOTHER = """
async def look(state: RunState):
    return {"drafts": [{"from": "look"}]}


class Listen:
    async def __call__(self, state: RunState):
        return {"drafts": [{"from": "listen"}]}


def join(state: RunState):
    return {"status": "accepted", "reason": " ".join(sorted(draft["from"] for draft in state["drafts"]))}


def build():
    graph = empty_graph().add_node(look).add_node("listen", Listen()).add_node(join)
    graph.add_edge(START, "look").add_edge(START, "listen").add_edge(["look", "listen"], "join")
    return graph
"""
ASYNC_EDGE = """
async def choose(state: RunState):
    return "accept"


def build():
    graph = empty_graph().add_node(note).add_node(accept)
    graph.add_edge(START, "note").add_conditional_edges("note", choose, ["accept", END])
    return graph
"""
ASYNC_IN_SUBGRAPH = """
async def look(state: RunState):
    return {"notes": ["looked inside"]}


def build():
    inner = empty_graph().add_node(look).add_edge(START, "look").compile()
    graph = empty_graph().add_node("inner", inner).add_node(accept)
    return graph.add_edge(START, "inner").add_edge("inner", "accept")
"""


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (ASYNC_NODE, "looked"),
        (ASYNC_BESIDE_ANOTHER, "listen look"),
        (ASYNC_EDGE, "noted"),
        (ASYNC_IN_SUBGRAPH, "looked inside"),
    ],
    ids=["a node", "nodes side by side", "a conditional edge", "a graph inside"],
)
def test_coroutine_functions_run(run: Run, body: str, reason: str) -> None:
    outcome = run(body)
    assert (outcome.record.status, outcome.record.reason, outcome.problem) == ("accepted", reason, None)


def test_coroutine_functions_run_where_an_event_loop_runs(run: Run) -> None:
    async def run_in_a_notebook() -> Outcome:
        return run(ASYNC_NODE)

    assert asyncio.run(run_in_a_notebook()).record.reason == "looked"


def test_a_coroutine_function_may_ask_a_person(run: Run) -> None:
    asked = run(ASYNC_NODE.replace("await asyncio.sleep(0)", "return {'notes': [interrupt('which one?')]}"))
    assert asked.record.status == "waiting"
    assert run(reply="the left one").record.reason == "the left one"


RETURN = "\n\ndef build():\n    return "
SEQUENCE = "empty_graph().add_sequence([{}, accept]).add_edge(START, '{}')\n"


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            "\n\ndef build():\n    raise RuntimeError('no\\nluck')\n",
            "mine.py:17: RuntimeError: no luck; mend",
        ),
        ("\n\ndef build():\n    raise SystemExit(3)\n", "mine.py:17: SystemExit: 3"),
        (f"{RETURN}empty_graph().add_edge(START, 'nowhere')\n", "unknown node `nowhere`"),
        (f"{RETURN}None\n", r"mine.py\): build\(\) returns NoneType; return a StateGraph"),
        (f"{RETURN}empty_graph().add_node(note).add_edge(START, 'note').compile()\n", "returns CompiledStateGraph"),
        ("\n\nimport nothing_of_this_name\n", "mine.py:16: ModuleNotFoundError: No module named"),
        ("\n\ndef build(:\n", "mine.py:16: SyntaxError: "),
        ("\n\nasync def look(state):\n    yield {}\n" + RETURN + SEQUENCE.format("look", "look"), "look is an asynch"),
        (
            "\n\nasync def look(state: RunState):\n    return {}\n"
            f"{RETURN}empty_graph().add_node(look, timeout=3).add_edge(START, 'look')\n",
            r"mine.py\): node 'look' has a timeout",
        ),
    ],
    ids=["raises", "exits", "an edge to nowhere", "nothing", "compiled", "an import", "no Python", "yields", "timeout"],
)
def test_a_graph_that_cannot_be_built_is_refused_before_a_folder_is_made(
    run: Run, tmp_path: Path, body: str, told: str
) -> None:
    with pytest.raises(ConfigError, match=f"'mine'.*{told}") as refused:
        run(body)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "run").exists()


def sequence(node: str, name: str = "node") -> str:
    """A graph of one node and its end."""
    return f"\n\n{node}\n{RETURN}{SEQUENCE.format(name, name)}"


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            sequence("def node(state):\n    return {'notes': state['nots']}"),
            "mine.py:17, in node 'node' of graph 'mine': ",
        ),
        (sequence("async def node(state):\n    1 / 0"), "mine.py:17, in node 'node' .*: ZeroDivisionError"),
        (
            sequence("def node():\n    return {}"),
            r"node 'node' of graph .*mine.py\): TypeError: node\(\) takes 0",
        ),
        (sequence("def node(state):\n    return 3"), r"graph 'mine' \(.*mine.py\): Expected dict, got 3"),
        (
            sequence("def node(state):\n    return {'notes': [node]}"),
            r"graph 'mine' .*mine.py\): TypeError: .*serial",
        ),
        (sequence("", "generate_sim"), "node 'generate_sim' .*mine.py.* needs 'task' in the state, and no node before"),
        (
            f"{RETURN}empty_graph().add_node('a', note).add_node('b', note)"
            ".add_edge(START, 'a').add_edge(START, 'b')\n",
            r"graph 'mine' \(.*mine.py\): At key 'notes': Can receive only one value per step",
        ),
        (
            f"{RETURN}empty_graph().add_node(note).add_edge(START, 'note')"
            ".add_conditional_edges('note', lambda state: 'left', {'right': END})\n",
            r"graph 'mine' \(.*mine.py\): KeyError: 'left'",
        ),
    ],
    ids=["a key", "awaited", "no argument", "no dict", "no data", "no task", "two writers", "an edge to nowhere"],
)
def test_what_a_graph_does_wrong_is_told_in_one_line_with_its_file(run: Run, body: str, told: str) -> None:
    outcome = run(body)
    assert isinstance(outcome.problem, ConfigError)
    assert (outcome.record.status, outcome.record.exit_status) == ("failed", 2)
    with pytest.raises(ConfigError, match=told):
        raise outcome.problem
    assert "\n" not in outcome.record.reason
    assert read_record(outcome.folder) == outcome.record


def test_a_shipped_graph_compiles_for_a_synchronous_run() -> None:
    assert "conclude" in compile_graph("grs").nodes
