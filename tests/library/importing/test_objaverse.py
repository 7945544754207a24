"""The real ``objaverse`` package against a host of our own, where it is installed: ``pip install objaverse``."""

import gzip
import importlib
import json
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trimesh

from grs_agents.base.errors import InputError
from grs_agents.library.importing.objaverse import download_objects, load_objaverse_package, search_objaverse
from tests.needs import require

TOLD: dict[str, dict[str, object]] = {
    "a1": {"name": "Red Mug", "tags": [], "license": "by", "faceCount": 12, "user": {"displayName": "ann"}},
    "b2": {"name": "Cup", "tags": [{"name": "mug"}, {"name": "red"}], "license": "by-nc", "faceCount": None},
    "c3": {"name": "Red House", "tags": [], "license": "cc0", "faceCount": 12},
}
PLACES = {"a1": "glbs/000-000/a1.glb", "b2": "glbs/000-001/b2.glb", "c3": "glbs/000-001/c3.glb"}


class Quiet(SimpleHTTPRequestHandler):
    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        pass


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder that the package downloads from; its cache is empty, as on a new machine."""
    require("objaverse")
    package = importlib.import_module("objaverse")
    root = tmp_path / "host"
    (root / "metadata").mkdir(parents=True)
    (root / "object-paths.json.gz").write_bytes(gzip.compress(json.dumps(PLACES).encode()))
    for folder in ("000-000", "000-001"):
        part = {uid: TOLD[uid] for uid, place in PLACES.items() if folder in place}
        (root / "metadata" / f"{folder}.json.gz").write_bytes(gzip.compress(json.dumps(part).encode()))
    for place in PLACES.values():
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        trimesh.Scene(trimesh.creation.box((0.08, 0.1, 0.06))).export(root / place)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    fetch = package.urllib.request.urlretrieve

    def from_here(url: str, path: str) -> object:
        return fetch(f"http://127.0.0.1:{server.server_port}/{url.partition('/resolve/main/')[2]}", path)

    monkeypatch.setattr(package.urllib.request, "urlretrieve", from_here)
    monkeypatch.setattr(package, "_VERSIONED_PATH", str(tmp_path / "cache" / "hf-objaverse-v1"))
    yield root
    server.shutdown()
    server.server_close()


def test_the_real_package_lists_and_downloads(host: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = search_objaverse(load_objaverse_package(), "red mug")
    assert [(one.uid, one.license, one.faces) for one in found] == [("a1", "CC-BY-4.0", 12), ("b2", "CC-BY-NC-4.0", 0)]
    assert not (tmp_path / "cache" / "hf-objaverse-v1" / "glbs").exists()
    named = download_objects(load_objaverse_package(), found[:1], tmp_path)
    assert list(named) == ["Red_Mug_a1.glb"] and (tmp_path / "Red_Mug_a1.glb").is_file()
    assert capsys.readouterr().out == ""


def test_what_is_cut_off_or_not_there_is_said(host: Path) -> None:
    whole = (host / "metadata" / "000-001.json.gz").read_bytes()
    (host / "metadata" / "000-001.json.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"metadata cannot be loaded.*objaverse"):
        search_objaverse(load_objaverse_package(), "red mug")


def test_metadata_is_read_folder_by_folder() -> None:
    asked: list[list[str]] = []

    def load(uids: list[str]) -> dict[str, dict[str, object]]:
        asked.append(uids)
        return {uid: TOLD[uid] for uid in uids}

    door: Any = SimpleNamespace(_load_object_paths=lambda: PLACES, load_annotations=load)
    assert [one.uid for one in search_objaverse(door, "red")] == ["a1", "c3", "b2"]
    assert asked == [["a1"], ["b2", "c3"]]
