"""The verbs that look at a run."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from io import BufferedReader
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt
import pytest
from typer.core import TyperGroup
from typer.main import get_command

from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.log import EventLog
from grs_agents.cli.commands import app
from grs_agents.cli.entry import main
from grs_agents.runs.record import RunRecord
from tests.cli.command import grs
from tests.needs import needs
from tests.slow import SLOW
from tests.views.browsing import page_once
from tests.views.conftest import Script

KEY = "a-very-secret-key-of-mine"


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a made-up run."""
    monkeypatch.setenv("COLUMNS", "160")
    folder = tmp_path / "run"
    folder.mkdir()
    script = Script(EventLog(folder / "events.jsonl"), folder)
    script.before_fix()
    script.after_fix(seconds=0.5)  # each frame of a film is drawn by rays
    script.log.close()
    RunRecord(
        id="sample-run",
        status="accepted",
        reason=f"said {KEY}",
        exit_status=0,
        command="run",
        source="/home/ada/photo",
        graph="grs",
        config=RecordedConfig.of(Config()),
        versions={"grs-agents": "0"},
        seeds=(0, 1),
    ).write(folder)
    return folder


def test_show_marks_a_step_whose_tests_failed(run: Path) -> None:
    tree = grs("show", "run", folder=run.parent).stdout
    assert "✗ run_tests" in tree and "✓ run_tests ×2" in tree and tree.count("✗") == 1


def test_a_long_verb_shows_on_a_terminal_alone_what_it_is_at(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    monkeypatch.setattr(sys, "argv", ["grs", "report", "run"])
    monkeypatch.setenv("TERM", "xterm")
    reader, writer = os.openpty()
    with os.fdopen(reader, "rb") as terminal, ThreadPoolExecutor(1) as pool:
        shown = pool.submit(read_terminal, terminal)
        with os.fdopen(writer, "w") as stderr, contextlib.redirect_stderr(stderr), pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        assert b"drawing" in shown.result() and "drawing" not in capsys.readouterr().out
    assert grs("report", "run", folder=run.parent).stderr == ""


def read_terminal(terminal: BufferedReader) -> bytes:
    """All that is written to a terminal until its other end is closed."""
    shown = b""
    with contextlib.suppress(OSError):  # so Linux says that it is
        while part := terminal.read1():
            shown += part
    return shown


def test_show_is_a_tree_a_step_or_json(run: Path) -> None:
    assert "└─ ✓ route" in grs("show", "run", folder=run.parent).stdout
    failed = grs("show", "run", "--failed", folder=run.parent).stdout
    assert failed.startswith("step 4: run_tests") and "AssertionError: 0.25 < 0.99" in failed
    step = json.loads(grs("show", "run", "--step", "6", "--json", folder=run.parent).stdout)
    assert [event["kind"] for event in step["events"]][1:4] == ["prompt", "reply", "program_version"]
    whole = json.loads(grs("show", "run", "--json", folder=run.parent).stdout)
    assert whole["run"]["status"] == "accepted" and len(whole["steps"]) == 8
    assert "one of 1 to 8" in grs("show", "run", "--step", "9", folder=run.parent).stderr


def test_a_report_is_a_page_a_film_or_the_recording(run: Path) -> None:
    assert grs("report", "run", folder=run.parent).returncode == 0
    assert "max_steps" in (run / "report.html").read_text("utf-8")
    done = grs("report", "run", "--out", "a.rrd", "--json", folder=run.parent)
    told = json.loads(done.stdout)
    assert told == {"file": "a.rrd", "bytes": (run.parent / "a.rrd").stat().st_size} and told["bytes"] > 10_000
    assert "name a file that ends in one of .html" in grs("report", "run", "--out", "a.avi", folder=run.parent).stderr
    refused = grs("report", "run", "--seed", "5", "--out", "a.gif", folder=run.parent)
    assert "name one of 0, 1" in refused.stderr
    assert "discriminator" in json.loads(grs("list", "--schema", folder=run.parent).stdout)


def test_every_verb_can_be_quiet_or_tell_more(run: Path) -> None:
    assert "Traceback" not in grs("show", "nowhere", folder=run.parent).stderr
    told = grs("show", "nowhere", "--verbose", folder=run.parent).stderr
    assert told.startswith("grs: nowhere holds no run") and "Traceback" in told
    assert grs("show", "run", "-q", folder=run.parent).stdout == grs("show", "run", folder=run.parent).stdout


def verbs(group: TyperGroup, before: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every verb with its command, those of groups too."""
    for name, command in group.commands.items():
        if isinstance(command, TyperGroup):
            yield from verbs(command, (*before, name))
        else:
            yield (*before, name), command


def test_every_verb_has_help_and_json_and_may_be_quiet_or_verbose(run: Path) -> None:
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    for words, _ in (every := list(verbs(group))):
        shown = grs(*words, "-h", folder=run.parent)
        assert shown.returncode == 0 and all(option in shown.stdout for option in ("-q, --quiet", "-v, --verbose")), (
            words
        )
        # an experiment has its own, a page prints nothing
        assert "--json" in shown.stdout or words in (("eval",), ("edit",)), words
    assert len(every) >= 28
    cheap: dict[str, tuple[str, ...]] = {
        "show": ("run",),
        "runs": (".",),
        "compare": ("run", "run"),
        "report": ("run", "--out", "a.rrd"),
        "graph": ("grs",),
        "list": (),
        "config": (),
        "mcp": (),
        "assets list": ("--all",),
        "assets show": ("HOPE/Milk.urdf", "--views", "1"),
        "assets verify": ("HOPE/Milk.urdf",),
    }
    for verb, arguments in cheap.items():
        done = grs(*verb.split(), *arguments, "--json", "--quiet", folder=run.parent)
        assert done.returncode == 0 and json.loads(done.stdout), (verb, done.stderr)
        assert done.stderr == "", verb
    assert {tool["name"] for tool in json.loads(grs("mcp", "--json", folder=run.parent).stdout)} >= {"scene", "check"}


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("runs --status acepted", "Did you mean accepted?"),
        ("batch --engine locl x", "Did you mean local?"),
        ("run groceries --set policy=ruls", "did you mean rules? use one of"),
        ("run groceries --set polcy=rules", "did you mean policy? use one of"),
        ("run groceries --model ofline", "did you mean offline? use one of"),
        ("run groceris", "did you mean groceries?"),
        ("graph gsr", "did you mean grs? use one of"),
        ("demos run --format lerobt", "did you mean lerobot? use one of"),
        ("lst", "Did you mean 'list'?"),
        ("list --jsn", "--json"),
    ],
)
def test_a_slip_of_the_pen_is_told_what_was_probably_meant(tmp_path: Path, line: str, meant: str) -> None:
    done = grs(*line.split(), folder=tmp_path)
    assert done.returncode == 2 and meant in done.stderr, done.stderr


def test_share_holds_neither_key_nor_home(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_API_KEY", KEY)
    done = grs("share", "run", folder=run.parent)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(run.parent / "run.zip") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    assert {"run/trace.rrd", "run/report.html", "run/events.jsonl"} <= set(content)
    assert not any(KEY.encode() in data or b"/home/ada" in data for data in content.values())
    assert b"~/photo" in content["run/run.json"]


def test_a_terminated_replay_leaves_no_server_running(run: Path) -> None:
    command = [sys.executable, "-m", "grs_agents", "replay", str(run), "--web"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line: str = process.stdout.readline()
            port = urlsplit(line.removeprefix("open ").strip()).port
            assert port and listens(port)
            process.terminate()
            assert process.wait(60) != 0
        finally:
            process.kill()
    assert not listens(port)


def listens(port: int) -> bool:
    """Whether a server of this machine answers at ``port``."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@needs("64-bit linux")  # elsewhere there is always a display
@pytest.mark.parametrize(("verb", "remedy"), [("replay --mujoco", "--out film.webp"), ("replay", "--web")])
def test_without_a_display_the_user_is_told_what_to_do(
    run: Path, monkeypatch: pytest.MonkeyPatch, verb: str, remedy: str
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = grs(*verb.split(), "run", folder=run.parent)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("grs: no display") and remedy in done.stderr and done.stderr.count("\n") == 1


@SLOW
@needs("browser")
def test_a_browser_shows_a_run_that_was_cut_short(run: Path) -> None:
    events = (run / "events.jsonl").read_bytes().splitlines(keepends=True)
    (run / "events.jsonl").write_bytes(b"".join(events[:-1]))
    command = [sys.executable, "-m", "grs_agents", "replay", str(run), "--web"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            assert process.stdout is not None
            url = process.stdout.readline().removeprefix("open ").strip()
            assert url.startswith("http://127.0.0.1:")
            image = page_once(url, lambda picture: colored(picture) > 200)
        finally:
            os.killpg(process.pid, signal.SIGTERM)
    assert colored(image) > 200
    assert image.std() > 10
    assert not (run / "trace.rrd").exists()


def colored(picture: npt.NDArray[np.uint8]) -> int:
    """Pixels with a colour in the panes of the viewer, between its tabs and its timeline: objects, photo, masks."""
    panes = picture[picture.shape[0] // 4 : picture.shape[0] * 3 // 4].astype(int)
    return int((panes.max(axis=-1) - panes.min(axis=-1) > 60).sum())
