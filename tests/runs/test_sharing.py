"""Nothing leaves that should not."""

import json
import struct
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import GrsError
from grs_agents.runs.sharing import REMOVED, Scrubber, make_scrubber, pack_run_as_zip, strip_png_metadata

KEY = "zq7Qm-very-secret"
KNOWN = (
    "sk-proj-abcdefghijklmnop1234",
    "AIzaSyA1234567890abcdefghijklmnopqrstuv",
    "ghp_abcdefghijklmnop1234567890",
    "hf_abcdefghijklmnopqrstuvwx",
    "AKIAABCDEFGHIJKLMNOP",
    "eyJhbGciOiJI.eyJzdWIiOiIx.SflKxwRJSMeKKF2QT4",
)


def a_scrubber(folder: Path) -> Scrubber:
    environment = {"MY_LLM": KEY, "OTHER_API_KEY": 'with"quote-and-more', "EDITOR_TOKEN": "short", "PATH": "/usr/bin"}
    return make_scrubber(folder, ["MY_LLM"], environment, home=Path("/somewhere/ada"))


def nothing(_: Path) -> Sequence[Path]:
    return ()


@pytest.mark.parametrize("key", [KEY, *KNOWN])
def test_keys_are_replaced_wherever_they_stand(tmp_path: Path, key: str) -> None:
    cleaner = a_scrubber(tmp_path)
    for text in (key, f'{{"Authorization": "Bearer {key}"}}', f"x={key};", f"line\n{key}\n"):
        assert cleaner.describe_leak(text.encode()) == "a key"
        cleaned = cleaner.remove_secrets(text)
        assert key not in cleaned and REMOVED in cleaned
        assert cleaner.describe_leak(cleaned.encode()) == ""


def test_home_folders_of_anybody_are_replaced(tmp_path: Path) -> None:
    cleaner = a_scrubber(tmp_path)
    for path in (
        "/home/ada/photos",
        "/Users/Ada Lovelace/x".replace(" ", ""),
        r"C:\Users\ada\x",
        r"C:\\Users\\ada\\x",
        "/somewhere/ada/photos",
        "/somewhere/ada",
    ):
        cleaned = cleaner.remove_secrets(f'"{path}"')
        assert "ada" not in cleaned.lower() and "~" in cleaned, cleaned
        assert cleaner.describe_leak(path.encode()) == "the path of a home folder"
    assert cleaner.remove_secrets("/somewhere/adam") == "/somewhere/adam"
    assert cleaner.remove_secrets(f"{tmp_path.resolve()}/scene/rgb.png") == "./scene/rgb.png"
    assert cleaner.remove_secrets("http://ada:lovelace@localhost:1") == f"http://{REMOVED}@localhost:1"
    assert cleaner.remove_secrets("a short home and /usr/bin stay") == "a short home and /usr/bin stay"


@given(st.text(), st.text())
def test_what_was_cleaned_leaks_nothing_and_stays(before: str, after: str) -> None:
    cleaner = a_scrubber(Path("/runs/one"))
    cleaned = cleaner.remove_secrets(f"{before}{KEY}{after}/home/ada/{before}")
    assert cleaner.describe_leak(cleaned.encode("utf-8", "replace")) == ""
    assert cleaner.remove_secrets(cleaned) == cleaned


def test_a_secret_with_quotes_is_found_inside_json(tmp_path: Path) -> None:
    cleaner = a_scrubber(tmp_path)
    cleaned = cleaner.remove_secrets(json.dumps({"reply": 'with"quote-and-more'}))
    assert json.loads(cleaned) == {"reply": REMOVED}


def commented_png() -> bytes:
    """A picture that says where it was taken."""
    data = cv2.imencode(".png", np.full((4, 4, 3), 9, np.uint8))[1].tobytes()
    body = b"tEXt" + b"Comment\0at /home/ada"
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return data[:-12] + chunk + data[-12:]


def test_a_picture_keeps_its_pixels_alone() -> None:
    bare = strip_png_metadata(commented_png())
    assert b"ada" not in bare
    image = cv2.imdecode(np.frombuffer(bare, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None and (image == 9).all()
    with pytest.raises(ValueError, match="not a PNG"):
        strip_png_metadata(b"GIF89a")


def test_the_zip_holds_the_run_scrubbed_and_nothing_that_cannot_be_looked_through(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    (folder / "scene").mkdir(parents=True)
    (folder / "run.json").write_text(json.dumps({"source": "/home/ada/photo", "key": KEY}))
    (folder / "task.json").write_text("{}")
    (folder / "scene" / "rgb.png").write_bytes(commented_png())
    for name in ("checkpoint.sqlite", "trace.rrd", ".env", "fake.png"):
        (folder / name).write_text(KEY)
    np.savez(folder / "good.npz", names=np.array(["cup"]), times=np.zeros(3))
    np.savez(folder / "bad.npz", names=np.array([KEY]))

    def make(copy: Path) -> Sequence[Path]:
        assert json.loads((copy / "run.json").read_text())["source"] == "~/photo"
        (copy / "trace.rrd").write_bytes(b"RRF2")
        return [copy / "trace.rrd"]

    done = pack_run_as_zip(folder, tmp_path / "out.zip", a_scrubber(folder), make)
    with zipfile.ZipFile(done.path) as archive:
        names = {name.removeprefix("run/") for name in archive.namelist()}
        assert names == {"run.json", "task.json", "scene/rgb.png", "good.npz", "trace.rrd"}
        assert not any(
            KEY.encode() in archive.read(name) or b"ada" in archive.read(name) for name in archive.namelist()
        )
    assert set(done.changed) == {"run.json", "scene/rgb.png"}
    assert set(done.left_out) == {"checkpoint.sqlite", ".env", "fake.png", "bad.npz"}
    assert done.files == 5


def test_what_would_still_leak_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "run.json").write_text("{}")

    def make(copy: Path) -> Sequence[Path]:
        (copy / "report.html").write_text(KEY)
        return []

    with pytest.raises(GrsError, match=r"report\.html would hold a key") as caught:
        pack_run_as_zip(folder, tmp_path / "out.zip", a_scrubber(folder), make)
    assert KEY not in str(caught.value)
    assert not (tmp_path / "out.zip").exists()
    (folder / "sk-abcdefghijklmnop1234.json").write_text("{}")
    with pytest.raises(GrsError, match="would hold a key"):
        pack_run_as_zip(folder, tmp_path / "out.zip", a_scrubber(folder), nothing)
