"""Runs that are killed, asked to end, or shared by two processes, and providers that say what they must not."""

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from grs_agents.base.trace.events import Decision, Prompt, Reply
from grs_agents.base.trace.log import read_events
from tests.cli.command import grs
from tests.slow import SLOW

KEY = "sk-0123456789-of-mine"
LOSSY = """
import contextlib, os, pathlib, signal
from grs_agents.base import content

def build():
    marker = pathlib.Path(__file__).with_suffix(".done")
    if not marker.exists():
        marker.touch()
        with contextlib.suppress(BaseException):
            os.kill(os.getpid(), signal.SIGNAL)
    return content.load_module("graphs", "grs").build()
"""
"""A graph that gets a signal before its first node, and drops the exception that tells of it."""

KILLED = """
import os, pathlib, signal
from grs_agents.base import content
from grs_agents.base.trace.log import EventLog

def build():
    written = EventLog.append

    def append(log, event):
        event = written(log, event)
        if event.sequence == MOMENT:
            os.kill(os.getpid(), signal.SIGKILL)
        return event

    marker = pathlib.Path(__file__).with_suffix(".done")
    if not marker.exists():
        marker.touch()
        EventLog.append = append
    return content.load_module("graphs", "grs").build()
"""
"""A graph that is killed once its log holds so many events, and goes on when it is built again."""


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "grs_agents", *arguments]


def asking(server: Any) -> list[str]:
    """Options that make the scripted server every role's model, the matcher's too."""
    names = ["models.default=openai:any", f"models.base_url={server.url}", "match.describe=each"]
    return [part for name in names for part in ("--set", name)]


def test_what_was_answered_at_once_is_not_asked_again(tmp_path: Path, small_scene: Path, scripted_server: Any) -> None:
    pytest.importorskip("langchain_openai")
    log = tmp_path / "run" / "events.jsonl"
    order = ["run", str(small_scene), "--out", str(tmp_path / "run"), "--json", "--set", "scene.group=off"]
    order += ["--set", "audit.seeds=1"]
    running: list[subprocess.Popen[bytes]] = []
    started, arrivals = Event(), count(1)

    def kill_once_two_are_answered() -> None:
        started.wait()
        if next(arrivals) == 3:
            while log.read_text().count('"kind":"reply"') < 2:
                time.sleep(0.01)
            running[0].kill()
            running[0].wait()

    scripted_server.arrived = kill_once_two_are_answered
    with subprocess.Popen(command(*order, *asking(scripted_server)), stdout=subprocess.DEVNULL) as process:
        running.append(process)
        started.set()
    done = grs(*order, *asking(scripted_server), "--resume", folder=tmp_path)
    assert json.loads(done.stdout)["status"] == "accepted", done.stderr
    assert [times for times in Counter(scripted_server.bodies).values() if times > 1] == [2]  # asked when it was killed
    events = read_events(log)
    answered = {event.call for event in events if isinstance(event, Reply)}
    asked = Counter(event.digest for event in events if isinstance(event, Prompt) and event.call in answered)
    assert set(asked.values()) == {1}


def test_a_run_is_of_one_process_and_does_not_wait_for_replies_when_it_is_asked_to_end(
    tmp_path: Path, small_scene: Path, scripted_server: Any
) -> None:
    pytest.importorskip("langchain_openai")
    arrivals, asked, go_on = count(1), Event(), Event()

    def hold() -> None:
        if next(arrivals) == 3:
            asked.set()
        go_on.wait()

    scripted_server.arrived = hold
    order = ["run", str(small_scene), "--out", str(tmp_path / "run")]
    order += ["--set", "models.timeout=3600", "--set", "scene.group=off", "--set", "match.describe=each"]
    with subprocess.Popen(command(*order, *asking(scripted_server)), stderr=subprocess.DEVNULL) as process:
        try:
            assert asked.wait(120)
            second = grs(*order, *asking(scripted_server), "--resume", folder=tmp_path)
            seen = grs("show", str(tmp_path / "run"), folder=tmp_path)
            process.terminate()
            assert process.wait(120) == 130
        finally:
            go_on.set()
    assert second.returncode == 2
    assert f"in use by process {process.pid}" in second.stderr and "--out" in second.stderr
    assert seen.returncode == 0 and "describe" in seen.stdout
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "interrupted"
    events = read_events(tmp_path / "run" / "events.jsonl")
    assert [event.sequence for event in events] == list(range(len(events)))
    assert sum(event.kind == "run_started" for event in events) == 1
    assert [event.answered for event in events if isinstance(event, Reply)] == [False] * 3


@SLOW
def test_whenever_a_run_is_killed_it_ends_alike_and_repeats_no_reply(
    tmp_path: Path, small_scene: Path, scripted_server: Any, pytestconfig: pytest.Config
) -> None:
    pytest.importorskip("langchain_openai")
    graphs = tmp_path / "content" / "graphs"
    graphs.mkdir(parents=True)
    broken = "```python\nimport unittest\n\nclass T(unittest.TestCase):\n    def test_a(self):\n        nowhere()\n```"

    def run(name: str, moment: int) -> tuple[list[int], dict[str, bytes], Counter[str]]:
        """Exit statuses of the run, if it is killed, and of what ends it; what it made; what the server was asked."""
        (graphs / f"{name}.py").write_text(KILLED.replace("MOMENT", str(moment)))
        scripted_server.bodies.clear()
        scripted_server.spoilt = {"task": ["none of your business"], "tests": [broken]}
        settings = [*asking(scripted_server), "--set", f"graph={name}"]
        order = ["--content", str(graphs.parent), "run", str(small_scene), "--out", str(tmp_path / name)]
        statuses: list[int] = []
        if moment >= 0:
            statuses.append(subprocess.run(command(*order, *settings), capture_output=True, check=False).returncode)
            assert json.loads((tmp_path / name / "run.json").read_text())["status"] == "running"
        statuses.append(grs(*order, *settings, *(["--resume"] if statuses else []), folder=tmp_path).returncode)
        assert json.loads((tmp_path / name / "run.json").read_text())["attempts"] == len(statuses)
        patterns = ("task.json", "*simulation.py", "scene.json", "audit.json", "instances/*.json", "history/*.py")
        files = [file for pattern in patterns for file in (tmp_path / name).glob(pattern)]
        made = {str(file.relative_to(tmp_path / name)): file.read_bytes() for file in files}
        return statuses, made, Counter(scripted_server.bodies)

    statuses, made, requests = run("whole", -1)
    assert statuses == [0] and len(made) > 8
    events = len(read_events(tmp_path / "whole" / "events.jsonl"))
    kills = int(pytestconfig.getoption("--kills") or 1)
    for number in range(kills):
        moment = events * (2 * number + 1) // (2 * kills)
        statuses, again, asked = run(f"killed_{moment}", moment)
        assert (statuses, again) == ([-9, 0], made), f"killed after event {moment} of {events}"
        told = read_events(tmp_path / f"killed_{moment}" / "events.jsonl")
        nodes = [event.node for event in told if event.kind == "node_ended"]
        assert nodes.count("read") == nodes.count("settle") == nodes.count("generate_sim") == 1
        under_way = sum(event.kind == "prompt" for event in told) - sum(event.kind == "reply" for event in told)
        assert not requests - asked and (asked - requests).total() <= under_way <= 8


@pytest.mark.parametrize("name", [pytest.param("SIGTERM", marks=SLOW), "SIGINT"])
def test_a_signal_before_the_first_node_is_not_lost(tmp_path: Path, known_scene: Path, name: str) -> None:
    graphs = tmp_path / "content" / "graphs"
    graphs.mkdir(parents=True)
    (graphs / "lossy.py").write_text(LOSSY.replace("SIGNAL", name))
    out = tmp_path / "run"
    order = ["--content", str(graphs.parent), "run", str(known_scene), "--out", str(out)]
    done = subprocess.run(
        command(*order, "--set", "graph=lossy"),
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    )
    assert done.returncode == 130, done.stderr
    assert f"grs --content {graphs.parent} run {known_scene} --out {out} --resume" in done.stderr
    assert json.loads((out / "run.json").read_text())["status"] == "interrupted"
    if name == "SIGTERM":
        again = grs(*order[:3], str(known_scene), "--out", str(out), "--resume", "--json", folder=tmp_path)
        assert json.loads(again.stdout)["status"] == "accepted", again.stderr


def test_every_file_of_a_run_outlasts_a_power_cut(tmp_path: Path, known_scene: Path, flushed: set[int]) -> None:
    done = grs("run", str(known_scene), "--out", "run", "--set", "audit.seeds=1", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    made = {str(file.relative_to(tmp_path / "run")): file.stat().st_ino for file in (tmp_path / "run").rglob("*")}
    others = {".lock", "checkpoint.sqlite", "trace.rrd"}  # SQLite flushes by itself; the trace is made of the events
    assert {name for name, inode in made.items() if inode not in flushed} <= others
    assert {(tmp_path / "run").stat().st_ino, tmp_path.stat().st_ino} <= flushed
    assert "instances/seed_0.npz" in made and json.loads((tmp_path / "run" / "run.json").read_text())["rewards"]


@pytest.mark.parametrize("role", ["task", "describe"])
def test_an_echoed_key_is_written_nowhere(
    tmp_path: Path, small_scene: Path, scripted_server: Any, monkeypatch: pytest.MonkeyPatch, role: str
) -> None:
    pytest.importorskip("langchain_openai")
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    scripted_server.spoilt["describe"] = [f"Your key is {KEY}.\n{{reply}}"]
    scripted_server.refused["task"] = f"{'x' * 280} wrong key {KEY}"
    if role == "describe":
        scripted_server.refused = {"describe": f"no such account: {KEY}"}
    done = grs("run", str(small_scene), "--out", "run", *asking(scripted_server), folder=tmp_path)
    assert done.returncode == 3 and "401" in done.stderr
    half = KEY[:12]
    assert half not in done.stdout + done.stderr
    files = [file for file in (tmp_path / "run").rglob("*") if file.is_file()]
    assert {"run.json", "events.jsonl", "checkpoint.sqlite", "trace.rrd"} <= {file.name for file in files}
    assert [file for file in files if half.encode() in file.read_bytes()] == []
    assert "[removed]" in (tmp_path / "run" / "events.jsonl").read_text()


def test_every_prompt_has_one_reply_with_what_it_cost(tmp_path: Path, small_scene: Path, scripted_server: Any) -> None:
    pytest.importorskip("langchain_openai")
    scripted_server.spoilt["describe"] = ["half a \ud800 pair", ""]
    scripted_server.refused["task"] = "the account is closed"
    one_by_one = ("--set", "models.concurrency=1")
    done = grs("run", str(small_scene), "--out", "run", *asking(scripted_server), *one_by_one, folder=tmp_path)
    assert done.returncode == 3
    events = read_events(tmp_path / "run" / "events.jsonl")
    prompts = [event.call for event in events if isinstance(event, Prompt)]
    replies = [event for event in events if isinstance(event, Reply)]
    assert prompts == [reply.call for reply in replies]
    *answered, last = replies
    assert {(reply.input_tokens, reply.output_tokens, reply.cost) for reply in answered} == {(10, 5, 0.25)}
    assert {reply.finish_reason for reply in answered} == {"stop"}
    described = [reply for reply in answered if reply.role == "describe"]
    assert [bool(reply.error) for reply in described[:3]] == [True, True, False]
    assert (last.role, last.answered) == ("task", False) and "the account is closed" in last.error


@SLOW
def test_rules_turn_to_the_other_program_when_a_fix_changed_nothing(
    tmp_path: Path, known_scene: Path, scripted_server: Any
) -> None:
    pytest.importorskip("langchain_openai")
    tests = "import unittest\n\nclass TestIt(unittest.TestCase):\n    def test_a(self):\n        nowhere()\n"
    broken = f"```python\n{tests}```"
    scripted_server.spoilt = {"tests": [broken], "fix_tests": [broken]}
    options = [*asking(scripted_server), "--set", "policy=rules"]
    done = grs("run", str(known_scene), "--out", "run", "--json", *options, folder=tmp_path)
    assert json.loads(done.stdout)["status"] == "accepted", done.stderr
    decisions = [event for event in read_events(tmp_path / "run" / "events.jsonl") if isinstance(event, Decision)]
    assert [decision.verdict for decision in decisions[:3]] == ["fix_test", "fix_code", "fix_test"]
    assert "left the report as it was" in decisions[1].explanation
