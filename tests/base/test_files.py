"""Files are written whole, or the old one stays and one line says why."""

import errno
import json
import os
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.base.files import flush_written_files, write_bytes, write_json, write_text
from tests.needs import needs


def test_missing_folders_are_made(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a" / "b" / "c.txt", "grün\n")
    assert path.read_bytes() == "grün\n".encode()


def test_a_file_is_replaced_whole_and_nothing_is_left_behind(tmp_path: Path) -> None:
    write_bytes(tmp_path / "x", b"a long old content")
    write_bytes(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["x"]


def test_a_reader_of_the_old_file_keeps_it_whole(tmp_path: Path) -> None:
    path = write_bytes(tmp_path / "x", b"old")
    with path.open("rb") as reader:
        write_bytes(path, b"new")
        assert reader.read() == b"old"


def test_a_folder_in_the_way_is_an_input_error_and_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    with pytest.raises(InputError, match=r"cannot write .*x: .*--out"):
        write_bytes(tmp_path / "x", b"new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["x"]


def test_a_file_where_a_folder_should_be_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        write_bytes(tmp_path / "x" / "y", b"new")


@needs("/dev/full")
def test_a_full_disk_is_an_input_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_to_full(self: Path, data: bytes) -> int:
        descriptor = os.open("/dev/full", os.O_WRONLY)
        try:
            return os.write(descriptor, data)
        finally:
            os.close(descriptor)

    monkeypatch.setattr(Path, "write_bytes", write_to_full)
    with pytest.raises(InputError, match="No space left on device; free space"):
        write_bytes(tmp_path / "x", b"new")


def test_a_durable_file_takes_what_was_written_before_it_along(tmp_path: Path, flushed: set[int]) -> None:
    """Who goes on after a power cut relies on the durable file, hence on all that it tells of."""
    early = write_bytes(tmp_path / "new" / "early", b"whole")
    assert not flushed
    last = write_json(tmp_path / "last.json", ["early"], durable=True)
    assert {path.stat().st_ino for path in (early, early.parent, last, tmp_path, tmp_path.parent)} <= flushed


def test_what_replaces_a_file_is_on_the_disk_first(tmp_path: Path, flushed: set[int]) -> None:
    write_bytes(tmp_path / "x", b"old")
    assert write_bytes(tmp_path / "x", b"new").stat().st_ino in flushed


def test_a_disk_that_takes_nothing_is_an_input_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    write_bytes(tmp_path / "x", b"old")
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(InputError, match="Input/output error"):
        write_bytes(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(value=values)
def test_json_reads_back_as_it_was(value: object, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = write_json(tmp_path_factory.getbasetemp() / "value.json", value)
    assert json.loads(path.read_text(encoding="utf-8")) == value


def test_json_refuses_nan_and_keeps_the_old_file(tmp_path: Path) -> None:
    write_json(tmp_path / "x.json", [1])
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "x.json", [float("nan")])
    assert json.loads((tmp_path / "x.json").read_text()) == [1]


def test_a_durable_write_waits_for_what_another_thread_flushes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    early = write_bytes(tmp_path / "early", b"whole").stat().st_ino
    flush, flushing, go_on = os.fsync, threading.Event(), threading.Event()
    flushed: list[int] = []

    def flush_slowly(descriptor: int) -> None:
        inode = os.fstat(descriptor).st_ino
        if inode == early:
            flushing.set()
            go_on.wait(60)
        flush(descriptor)
        flushed.append(inode)

    monkeypatch.setattr(os, "fsync", flush_slowly)
    first = threading.Thread(target=flush_written_files)
    first.start()
    assert flushing.wait(60)
    held: list[bool] = []

    def write_and_look() -> None:
        write_bytes(tmp_path / "late", b"whole", durable=True)
        held.append(early in flushed)

    second = threading.Thread(target=write_and_look)
    second.start()
    second.join(0.5)  # without a lock it ends at once
    go_on.set()
    first.join()
    second.join()
    assert held == [True]


@pytest.mark.parametrize(("fault", "right"), [(errno.EMFILE, False), (errno.EIO, False), (errno.ENOENT, True)])
def test_a_file_that_cannot_be_opened_is_not_taken_for_flushed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: int, right: bool
) -> None:
    early = write_bytes(tmp_path / "early", b"whole")
    opened = os.open

    def fail(path: Path, flags: int, mode: int = 0o777) -> int:
        if path == early:
            raise OSError(fault, os.strerror(fault))
        return opened(path, flags, mode)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", fail)
        if right:
            flush_written_files()
        else:
            with pytest.raises(OSError, match=os.strerror(fault)):
                flush_written_files()
    monkeypatch.setattr(os, "open", lambda path, flags: tried.append(path) or opened(path, flags))
    tried: list[Path] = []
    flush_written_files()
    assert (early in tried) != right  # what was not flushed is tried again
