"""The event log: numbering, subscribers, crashes."""

import os
import subprocess
import sys
import tempfile
import threading
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.trace.events import EVENT, Event, Finding, NodeEnded, NodeStarted, Note, Reply
from grs_agents.base.trace.log import EventLog, read_events


def test_events_are_stamped_written_and_told_in_order(tmp_path: Path) -> None:
    received: list[Event] = []
    with EventLog(tmp_path / "events.jsonl") as log:
        log.subscribe(received.append)
        first = log.append(NodeStarted(node="route", visit=2))
        log.attempt = 3
        second = log.append(Note(text="line\nbreak \ud800"))
    assert (first.sequence, first.attempt, second.sequence, second.attempt) == (0, 0, 1, 3)
    assert first.time > 1e9
    assert received == [first, second] == read_events(tmp_path / "events.jsonl")


def test_an_event_is_in_the_file_before_anybody_is_told(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    seen: list[int] = []
    log = EventLog(path)
    log.subscribe(lambda event: seen.append(len(read_events(path))))
    log.append(Note(text="a"))
    log.append(Note(text="b"))
    assert seen == [1, 2]


def test_a_resumed_log_goes_on_counting(tmp_path: Path) -> None:
    path = tmp_path / "run" / "events.jsonl"
    with EventLog(path) as log:
        log.attempt = 2
        log.append(Note(text="a"))
    with EventLog(path) as log:
        assert log.append(Note(text="b")).sequence == 1
        assert log.attempt == 2


def test_what_is_not_done_again_outlasts_a_power_cut(tmp_path: Path, flushed: set[int]) -> None:
    path = tmp_path / "events.jsonl"
    with EventLog(path) as log:
        mask = write_bytes(tmp_path / "scene" / "mask.png", b"whole")
        log.append(NodeStarted(node="segment", visit=1))
        log.append(Reply(call="a", role="describe", model="offline", text="a cup", seconds=0.001))
        assert not flushed & {mask.stat().st_ino, path.stat().st_ino}
        log.append(NodeEnded(node="segment", seconds=0.1))
        assert flushed >= {mask.stat().st_ino, mask.parent.stat().st_ino, tmp_path.stat().st_ino, path.stat().st_ino}
        flushed.clear()
        log.append(Reply(call="b", role="describe", model="paid", text="a cup", seconds=2.0))
        assert path.stat().st_ino in flushed


@given(st.lists(st.text(max_size=20), min_size=1, max_size=5), st.floats(0, 1))
def test_a_log_torn_anywhere_is_repaired(texts: list[str], share: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "events.jsonl"
        with EventLog(path) as log:
            written = [log.append(Note(text=text)) for text in texts]
        whole = path.read_bytes()
        length = round(share * len(whole))
        path.write_bytes(whole[:length])
        kept = read_events(path)
        assert kept == written[: len(kept)]
        assert len(kept) >= whole[:length].count(b"\n")
        with EventLog(path) as log:
            added = log.append(Note(text="after"))
        assert read_events(path) == [*kept, added]
        assert added.sequence == len(kept)


def test_a_broken_line_in_the_middle_is_an_error_with_its_number(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    good = EVENT.dump_json(Note(text="a"))
    path.write_bytes(good + b"\nnonsense\n" + good + b"\n")
    with pytest.raises(InputError, match=r"events.jsonl line 2 is not an event"):
        read_events(path)
    with pytest.raises(InputError, match="line 2"):
        EventLog(path)


def test_a_missing_log_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_events(tmp_path / "none.jsonl")


def test_a_folder_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        EventLog(tmp_path / "file" / "events.jsonl")


def run_program(folder: Path, program: str) -> "subprocess.CompletedProcess[str]":
    """Run Python source in ``folder``."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [
        sys.executable,
        "-c",
        "import os, pathlib, signal\nfrom grs_agents.base.trace.events import Note\n"
        f"from grs_agents.base.trace.log import EventLog\n{program}",
    ]
    return subprocess.run(command, cwd=folder, env=environment, check=False, capture_output=True, text=True)


def test_a_disk_with_no_room_is_an_input_error(tmp_path: Path) -> None:
    program = """
import resource
from grs_agents.base.errors import InputError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
log = EventLog(pathlib.Path("events.jsonl"))
try:
    for number in range(9):
        log.append(Note(text="x" * 50))
except InputError as error:
    print(error)
"""
    done = run_program(tmp_path, program)
    assert done.stdout.startswith("cannot write events.jsonl: File too large; free space"), done.stderr


def test_a_failing_subscriber_is_reported_once_and_stops_nobody(tmp_path: Path) -> None:
    received: list[Event] = []

    def fail(event: Event) -> None:
        raise ValueError("no screen")

    with EventLog(tmp_path / "events.jsonl") as log:
        log.subscribe(fail)
        log.subscribe(received.append)
        with pytest.warns(RuntimeWarning, match=r"fail failed at event 0 \(note\).*ValueError: no screen"):
            log.append(Note(text="a"))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            log.append(Note(text="b"))
    assert [event.sequence for event in received] == [0, 1]


def test_an_interrupt_in_a_subscriber_goes_through(tmp_path: Path) -> None:
    def interrupt(event: Event) -> None:
        raise KeyboardInterrupt

    log = EventLog(tmp_path / "events.jsonl")
    log.subscribe(interrupt)
    with pytest.raises(KeyboardInterrupt):
        log.append(Note(text="a"))
    assert len(read_events(log.path)) == 1


def test_threads_never_mix_lines_or_numbers(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "events.jsonl")
    received: list[int] = []
    log.subscribe(lambda event: received.append(event.sequence))

    def write() -> None:
        for _ in range(50):
            log.append(Note(text="x" * 200))

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [event.sequence for event in read_events(log.path)] == list(range(200)) == received


def test_a_killed_writer_leaves_every_event_it_appended(tmp_path: Path) -> None:
    program = """
log = EventLog(pathlib.Path("events.jsonl"))
for number in range(20):
    log.append(Note(text=str(number)))
os.kill(os.getpid(), signal.SIGKILL)
"""
    assert run_program(tmp_path, program).returncode == -9
    assert len(read_events(tmp_path / "events.jsonl")) == 20


def test_an_older_vocabulary_is_read_and_a_later_one_named(tmp_path: Path) -> None:
    file = tmp_path / "events.jsonl"
    first = b'{"version":1,"kind":"reply","call":"a","role":"match","model":"m","text":"yes"}\n'
    file.write_bytes(first)
    assert read_events(file)[0].version == 1
    file.write_bytes(b'{"version":3,"kind":"finding","check":"solved","passed":true,"detail":"1.00; 0.99 is asked"}\n')
    finding = read_events(file)[0]
    assert isinstance(finding, Finding) and finding.detail == finding.measured == "1.00; 0.99 is asked"
    file.write_bytes(first + b'{"version":99,"kind":"dance","text":"x"}\n' + first)
    with pytest.raises(InputError, match=r"line 2 is an event of version 99.*later version"):
        read_events(file)
