"""A run folder received from somebody is read or refused in one line, and nothing outside it is read."""

import json
import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.api import Run
from grs_agents.base import content
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError
from grs_agents.base.trace.log import EventLog
from grs_agents.runs.record import RunRecord
from tests.cli.command import Done, grs
from tests.cli.mutations import KINDS, mutate
from tests.views.conftest import Script

EVIL = "\x1b]0;owned\x07 \x9b31m \u202e"
RECORD = ("report", "run", "--out", "run/trace.rrd")
READING = (("show", "run"), ("show", "run", "--json"), RECORD, ("report", "run"), ("share", "run"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a made-up run that was interrupted."""
    folder = tmp_path_factory.mktemp("made") / "run"
    folder.mkdir()
    script = Script(EventLog(folder / "events.jsonl"), folder)
    script.before_fix()
    script.after_fix(seconds=0.5)  # each frame of a film is drawn by rays
    script.log.close()
    RunRecord(
        id="sample-run",
        status="interrupted",
        command="run",
        source="/photo",
        graph="grs",
        config=RecordedConfig.of(Config()),
        versions={},
        seeds=(0, 1),
    ).write(folder)
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of it to spoil."""
    return Path(shutil.copytree(made, tmp_path / "run"))


def change_events(run: Path, change: Callable[[dict[str, Any]], None], kind: str) -> None:
    """Change every event of a kind."""
    events = [json.loads(line) for line in (run / "events.jsonl").read_text("utf-8").splitlines()]
    for event in events:
        if event["kind"] == kind:
            change(event)
    (run / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events), "utf-8")


def assert_refused(done: Done, *words: str) -> None:
    """One line that names what is wrong, and exit status 2."""
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("grs: ") and len(done.stderr.splitlines()) == 1, done.stderr
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize("verb", [RECORD, ("report", "run"), ("share", "run")], ids=" ".join)
@pytest.mark.parametrize("where", ["absolute", "above"])
def test_a_picture_elsewhere_is_not_read(run: Path, verb: tuple[str, ...], where: str) -> None:
    shutil.copy(run / "rgb.png", run.parent / "secret.png")
    name = str(run.parent / "secret.png") if where == "absolute" else "../secret.png"
    change_events(run, lambda event: event["files"].update(rgb=name), "scene_stage")
    assert_refused(grs(*verb, folder=run.parent), "secret.png", "no path inside")
    assert not (run / "report.html").exists() and not (run.parent / "run.zip").exists()


@pytest.mark.parametrize("verb", [*READING, ("replay", "run"), ("replay", "run", "--mujoco")], ids=" ".join)
@pytest.mark.parametrize("what", ["link", "pipe", "device"])
def test_links_out_and_special_files_are_refused_by_name(run: Path, verb: tuple[str, ...], what: str) -> None:
    shutil.copy(run / "rgb.png", run.parent / "secret.png")
    (run / "rgb.png").unlink()
    if what == "pipe":
        os.mkfifo(run / "rgb.png")
    else:
        (run / "rgb.png").symlink_to("/dev/zero" if what == "device" else run.parent / "secret.png")
    assert_refused(grs(*verb, folder=run.parent), "rgb.png")


def test_a_link_inside_the_folder_is_followed(run: Path) -> None:
    (run / "rgb.png").rename(run / "photo.png")
    (run / "rgb.png").symlink_to("photo.png")
    assert grs(*RECORD, folder=run.parent).returncode == 0


@pytest.mark.parametrize("shape", [(10**12, 3), (40_000_000, 3)])
def test_a_recording_is_bounded_before_it_is_unpacked(run: Path, shape: tuple[int, int]) -> None:
    import io
    import zipfile

    file = next(run.rglob("*.npz"))
    header = io.BytesIO()
    said = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, said)
    with np.load(file) as found:
        arrays = {name: found[name] for name in found.files if name != "tool"}
    np.savez(file, **arrays)
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tool.npy", header.getvalue() + bytes(1_000_000))
    assert_refused(grs(*RECORD, folder=run.parent), "tool", file.name, "more than")


@pytest.mark.parametrize("name", ["run.json", "events.jsonl", "instances/seed_0.json"])
@pytest.mark.parametrize("text", ["[" * 100_000 + "]" * 100_000, "[" + "[]," * 1_000_000 + "[]]"])
def test_deep_and_wide_json_is_refused(run: Path, name: str, text: str) -> None:
    file = next(run.rglob("*.json")) if name.startswith("instances") and not (run / name).exists() else run / name
    after = file.read_text("utf-8") if name == "events.jsonl" else ""
    file.write_text(f"{text}\n{after}", "utf-8")
    assert_refused(grs(*RECORD, folder=run.parent), file.name)


def test_a_file_too_large_to_read_is_refused_unread(run: Path) -> None:
    os.truncate(run / "events.jsonl", 8 << 30)
    assert_refused(grs("show", "run", folder=run.parent), "events.jsonl", "8589934592", "more than")


def not_a_database(file: Path) -> None:
    file.write_text("junk")


def another_database(file: Path) -> None:
    with sqlite3.connect(file) as database:
        database.execute("CREATE VIEW checkpoints AS SELECT 1")
    database.close()


def torn_checkpoint(file: Path) -> None:
    from langgraph.checkpoint.sqlite import SqliteSaver

    with SqliteSaver.from_conn_string(str(file)) as saver:
        saver.setup()
        saver.conn.execute(
            "INSERT INTO checkpoints (thread_id, checkpoint_ns, checkpoint_id, type, checkpoint, metadata) "
            "VALUES ('sample-run', '', '1', 'msgpack', X'C1C1', '{}')"
        )
        saver.conn.commit()


@pytest.mark.parametrize("spoil", [not_a_database, another_database, torn_checkpoint])
def test_a_broken_checkpoint_is_named(run: Path, spoil: Callable[[Path], None]) -> None:
    spoil(run / "checkpoint.sqlite")
    done = grs("run", "/photo", "--out", "run", "--resume", folder=run.parent)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    assert "checkpoint.sqlite" in done.stderr and "start the scene again" in done.stderr


def test_what_a_run_says_cannot_command_the_terminal(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    change_events(run, lambda event: event.update(explanation=EVIL + "[bold]loud[/bold]"), "decision")
    change_events(run, lambda event: event.update(node=event["node"] + EVIL), "node_started")
    for options in ((), ("--step", "1"), ("--failed",), ("--json",)):
        done = grs("show", "run", *options, folder=run.parent)
        assert done.returncode == 0
        assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(done.stdout + done.stderr)
    shown = grs("show", "run", folder=run.parent).stdout
    assert "\\x1b]0;owned\\x07" in shown and "[bold]loud[/bold]" in shown


@pytest.mark.parametrize("seed", range(2 * len(KINDS)))
def test_a_run_that_was_changed_anywhere_is_read_or_refused(run: Path, seed: int) -> None:
    what = mutate(run, seed)
    for verb in READING[:3]:
        done = grs(*verb, folder=run.parent)
        assert done.returncode in (0, 2), f"{what}: {done.stderr}"
        assert "Traceback" not in done.stderr and "\x1b" not in done.stdout + done.stderr, what


def change_record(run: Path, **settings: Any) -> None:
    """Have the record of a run ask for other settings."""
    record = json.loads((run / "run.json").read_text("utf-8"))
    record["config"].update(settings)
    (run / "run.json").write_text(json.dumps(record), "utf-8")


MARKING = """
import os, pathlib
from grs_agents.sim import Task

class Evil(Task):
    def reset(self, env):
        pathlib.Path("{marker}").write_text(str(os.getpid()))
"""


@pytest.fixture
def begun(tmp_path: Path, known_scene: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stranger's run that waits for a reply before a program of theirs is tested."""
    monkeypatch.setattr(content, "_overlays", [])
    (tmp_path / "graphs").mkdir()
    program = MARKING.format(marker=tmp_path / "escaped")
    (tmp_path / "graphs" / "asking.py").write_text(ASKING.format(program=program), "utf-8")
    done = grs("--content", ".", "run", str(known_scene), "--out", "r", "--set", "graph=asking", folder=tmp_path)
    assert done.returncode == 4, done.stderr
    return tmp_path / "r"


ASKING = """
from langgraph.graph import END, START, StateGraph
from langgraph.types import interrupt
from grs_agents.graph.state import RunState

VERDICT = True

def ask(state):
    interrupt({{"text": "go on?"}})
    return {{}}

def test(state, runtime):
    found = runtime.context.run_tool("run_tests", seed=0, simulation={program!r}, tests=TESTS)
    return {{"status": "rejected", "reason": f"backend {{found.report.backend}}"}}

TESTS = '''
import unittest
from task_code import Evil

class T(unittest.TestCase):
    def test_it(self):
        Evil().reset(None)
'''

def build():
    graph = StateGraph(RunState, context_schema=object)
    graph.add_node("ask", ask)
    graph.add_node("test", test)
    graph.add_edge(START, "ask")
    graph.add_edge("ask", "test")
    graph.add_edge("test", END)
    return graph
"""


@pytest.mark.parametrize("verb", ["approve", "run"])
def test_a_record_that_asks_for_no_sandbox_gets_the_sandbox_of_this_machine(begun: Path, verb: str) -> None:
    change_record(begun, sandbox="none")
    order = ("approve", "r", "--reply", "yes") if verb == "approve" else ("run", "--out", "r", "--resume")
    done = grs("--content", ".", *order, "--json", folder=begun.parent, own_sandbox=True)
    if verb == "run":  # it still waits, with no way past the question
        assert done.returncode == 4
        return
    assert done.returncode == 1, done.stderr
    reason = json.loads(done.stdout)["reason"]
    assert reason.startswith("backend ") and "none" not in reason
    assert not (begun.parent / "escaped").exists()


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ({"record": "../written.json"}, "record"),
        ({"cassette": "../read.json"}, "cassette"),
        ({"policy": "package.module:Policy"}, "policy"),
        ({"robot": "/home/somebody/arm.xml"}, "robot"),
        ({"models": {"default": {"model": "openai:x", "base_url": "http://127.0.0.1:9/v1"}}}, "base_url"),
        ({"limits": {"memory_mib": 60000}}, "limits.memory_mib"),
    ],
    ids=str,
)
def test_a_record_that_asks_for_files_code_or_endpoints_is_refused_in_one_line(
    begun: Path, setting: dict[str, Any], word: str
) -> None:
    change_record(begun, **setting)
    for order in (("approve", "r", "--reply", "yes"), ("approve", "r", "--reply", "yes", "--json")):
        assert_refused(grs("--content", ".", *order, folder=begun.parent), word, "a run folder cannot choose")
    with pytest.raises(ConfigError, match="a run folder cannot choose"):
        Run(begun).resume("yes")
    assert not (begun.parent / "written.json").exists()


def test_a_folder_without_checkpoint_does_not_choose_the_photo(run: Path, small_scene: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(run, tmp_path / "theirs"))
    record = json.loads((copy / "run.json").read_text("utf-8"))
    record |= {"status": "interrupted", "exit_status": None, "source": str(small_scene)}
    (copy / "run.json").write_text(json.dumps(record), "utf-8")
    (copy / "checkpoint.sqlite").unlink(missing_ok=True)
    done = grs("run", "--out", "theirs", "--resume", folder=tmp_path)
    assert done.returncode == 2 and "name the scene" in done.stderr, done


BEFORE_AND_AFTER_READ = """
from pathlib import Path
from langgraph.graph import END, START, StateGraph
from grs_agents.graph.perceive import read_photo_into_run
from grs_agents.graph.services import logged_node
from grs_agents.graph.state import RunState

VERDICT = True

@logged_node("stop")
def stop(state, services):
    if Path({stop!r}).exists():
        raise RuntimeError("stopped here")
    return {{}}

def look(state, runtime):
    photo = runtime.context.load_photo(state)
    return {{"status": "rejected", "reason": f"a photo of {{photo.rgb.shape}}"}}

def build():
    graph = StateGraph(RunState, context_schema=object)
    for name, node in (("stop", stop), ("read", read_photo_into_run), ("look", look)):
        graph.add_node(name, node)
    for start, end in zip((START, *{order!r}), (*{order!r}, END)):
        graph.add_edge(start, end)
    return graph
"""


def make_stopped_run(folder: Path, scene: Path, *order: str) -> Path:
    """A run of the nodes in ``order`` that stopped at its node ``stop``, and would go on now."""
    (folder / "graphs").mkdir()
    (folder / "stop").touch()
    text = BEFORE_AND_AFTER_READ.format(stop=str(folder / "stop"), order=order)
    (folder / "graphs/stopped.py").write_text(text, "utf-8")
    done = grs("--content", ".", "run", str(scene), "--out", "r", "--set", "graph=stopped", folder=folder)
    assert done.returncode == 2 and "stopped here" in done.stderr, done.stderr
    (folder / "stop").unlink()
    return folder / "r"


def test_a_folder_alone_does_not_choose_a_photo_outside_of_it(tmp_path: Path, small_scene: Path) -> None:
    run = make_stopped_run(tmp_path, small_scene, "stop", "read", "look")
    resumed = ("--content", ".", "run", "--out", "r", "--resume", "-q")
    assert_refused(grs(*resumed, folder=tmp_path), str(small_scene), f"name it: grs run {small_scene} --out {run}")
    done = grs(*resumed, str(small_scene), "--json", folder=tmp_path)
    assert json.loads(done.stdout)["reason"].startswith("a photo of ("), done.stderr


def test_pictures_of_a_resumed_folder_are_decoded_in_a_worker(
    tmp_path: Path, small_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_stopped_run(tmp_path, small_scene, "read", "stop", "look")

    def refuse(*_: object) -> None:
        raise AssertionError("decoded in this process")

    monkeypatch.setattr(cv2, "imdecode", refuse)
    monkeypatch.setattr(content, "_overlays", [])
    content.add_overlay_folder(tmp_path)
    assert Run(run).resume().record.reason.startswith("a photo of (")


def test_long_foreign_programs_are_not_compared_line_by_line(run: Path) -> None:
    other = Path(shutil.copytree(run, run.parent / "other"))
    for folder, step in ((run, 7919), (other, 23757)):
        (folder / "simulation.py").write_text("".join(f"{step * line % 3000}\n" for line in range(100_000)))
    done = grs("compare", "run", "other", "--json", folder=run.parent)
    assert json.loads(done.stdout)["differences"]["simulation.py"] == ["100000 lines", "100000 lines"]
