"""The graphs behind LangGraph's own server."""

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Generator
from pathlib import Path
from typing import Any, cast

import pytest
from langgraph.checkpoint.memory import InMemorySaver
from langgraph.graph import StateGraph
from langgraph.types import Command

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.base.trace.log import read_events
from grs_agents.graph.state import RunState
from grs_agents.runs.record import read_record
from grs_agents.serving.langgraph_server import build_served_graph, grs, router, scene
from tests.needs import needs
from tests.slow import SLOW
from tests.views.looking import free_port

ROOT = Path(__file__).parents[2]


def test_langgraph_json_serves_every_graph() -> None:
    """The server imports the module of each entry and takes the graph from its ``__dict__``, past ``__getattr__``."""
    graphs: dict[str, str] = json.loads((ROOT / "langgraph.json").read_text(encoding="utf-8"))["graphs"]
    assert sorted(graphs) == content.content_names("graphs")
    for name, target in graphs.items():
        module, _, variable = target.partition(":")
        graph = importlib.import_module(module).__dict__[variable]
        assert isinstance(graph, StateGraph) and name in graph.nodes


def given(**fields: Any) -> RunState:
    """What a request sends."""
    return cast(RunState, fields)


def test_a_served_graph_leaves_a_run_and_streams_its_nodes(
    tmp_path: Path, small_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    steps: list[Any] = list(
        scene.compile().stream(
            given(scene_path=str(small_scene)),
            {"configurable": {"set": ["seed=3"]}},
            stream_mode="updates",
            subgraphs=True,
        )
    )
    assert [next(iter(update)) for where, update in steps if len(where) < 2] == [
        "read",
        "find_table",
        "segment",
        "describe",
        "match",
        "register",
        "settle",
        "scene",
    ]
    ended = steps[-1][1]["scene"]
    record = read_record(Path(ended["folder"]))
    assert (record.status, record.config.as_json()["seed"], record.graph) == ("accepted", 3, "scene")
    assert len(ended["scene"]["objects"]) == 3
    assert read_events(Path(ended["folder"]) / "events.jsonl")[-1].kind == "run_ended"
    assert (Path(ended["folder"]) / "trace.rrd").is_file()


def test_what_a_request_leaves_out_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="names no scene"):
        grs.compile().invoke(given(max_fixes=3))
    with pytest.raises(InputError, match="nowhere"):
        grs.compile().invoke(given(scene_path="nowhere"))
    (tmp_path / "photo").mkdir()
    with pytest.raises(ConfigError, match="needs task and scene"):
        router.compile().invoke(given(scene_path="groceries"))
    with pytest.raises(ConfigError, match="policy"):
        grs.compile().invoke(
            given(scene_path=str(content.content_path("assets", "scenes") / "groceries")),
            {"configurable": {"set": ["policy=none_such"]}},
        )


@contextlib.contextmanager
def langgraph_dev(folder: Path) -> Generator[str]:
    """The address of a development server."""
    port = free_port()
    address = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "langgraph_cli", "dev", "--config", str(ROOT / "langgraph.json")]
    command += ["--host", "127.0.0.1", "--port", str(port), "--no-browser", "--no-reload"]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "LANGSMITH_TRACING": "false", "LANGGRAPH_CLI_NO_ANALYTICS": "1"}
    with (folder / "server.log").open("wb") as log:
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)
    try:
        while process.poll() is None:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"{address}/ok", timeout=5):
                break
        yield address
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(30)


@SLOW
@needs("langgraph_api")
def test_langgraph_dev_serves_a_scene(tmp_path: Path, small_scene: Path) -> None:
    body: dict[str, Any] = {"assistant_id": "scene", "input": {"scene_path": str(small_scene)}}
    with langgraph_dev(tmp_path) as address:
        request = urllib.request.Request(
            f"{address}/runs/wait", json.dumps(body).encode(), {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(request, timeout=200) as reply:
            ended = json.load(reply)
    assert len(ended["scene"]["objects"]) == 3
    assert read_record(tmp_path / ended["folder"]).status == "accepted"


def test_a_served_graph_waits_for_a_person_and_goes_on_in_the_same_run(
    tmp_path: Path, sample_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(content, "_overlays", [])
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "asking.py").write_text(ASKING, encoding="utf-8")
    content.add_overlay_folder(tmp_path)
    graph = build_served_graph("asking").compile(InMemorySaver())
    thread: Any = {"configurable": {"thread_id": "7"}}
    graph.invoke(given(scene_path=str(sample_scene)), thread)
    (folder,) = (tmp_path / "runs").iterdir()
    assert read_record(folder).status == "waiting"
    ended = graph.invoke(Command(resume="a person's reply"), thread)
    assert (read_record(folder).status, read_record(folder).reason) == ("accepted", "a person's reply")
    assert Path(ended["folder"]).resolve() == folder


ASKING = """\
from langgraph.graph import END, START, StateGraph
from langgraph.types import interrupt

from grs_agents.graph import Services
from grs_agents.graph.state import RunState


def ask(state: RunState):
    return {"status": "accepted", "reason": interrupt("Shall it be?")}


def build():
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("ask", ask)
    graph.add_edge(START, "ask")
    graph.add_edge("ask", END)
    return graph
"""
