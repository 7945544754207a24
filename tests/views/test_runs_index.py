"""The page of runs: cards with their own pictures and films, foreign text escaped, damaged files left out."""

import base64
import re
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.content import content_path
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.trace.log import EventLog
from grs_agents.views.runs_index.page import write_runs_page
from tests.views.conftest import write_rollout

RECORD: dict[str, Any] = {
    "status": "accepted",
    "reason": "all hold",
    "source": "photos/<script>alert(2)</script>",
    "graph": "grs",
    "sentence": "<script>alert(1)</script> & the milk",
    "config": {"robot": "/home/me/arms/gantry.xml", "hand": "suction", "seed": 3},
    "counts": {"objects": 2},
    "rewards": [1.0],
    "seconds": {"total": 2.0},
    "cost": None,
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs: one with photo and rollout, one with a torn photo, a link out of it and no event."""
    root = tmp_path_factory.mktemp("runs")
    for name in ("good", 'javascript:alert(3)"'):
        (root / name / "scene").mkdir(parents=True)
        write_json(root / name / "task.json", {"task-name": "move-milk", "task-description": "Move the <b>milk</b>."})
    good, bad = root / "good", root / 'javascript:alert(3)"'
    photo = content_path("assets", "scenes") / "groceries" / "rgb.png"
    (good / "scene" / "rgb.png").write_bytes(photo.read_bytes())
    with EventLog(good / "events.jsonl") as log:
        log.append(write_rollout(good, 0, 0.5))
    (bad / "scene" / "rgb.png").write_bytes(photo.read_bytes()[:999])
    (bad / "scene" / "twin.png").symlink_to(photo)
    return root


def write(root: Path, page: Path, *, films: bool = False) -> str:
    folders = (root / "good", root / 'javascript:alert(3)"')
    records = (RECORD, {**RECORD, "status": "rejected"})
    return write_runs_page(list(zip(folders, records, strict=True)), page, films).read_text("utf-8")


def test_cards_have_pictures_of_their_own_beside_the_page(runs: Path) -> None:
    page = write(runs, runs / "runs.html", films=True)
    pictures = re.findall(r'<img class="(\w+)" loading="lazy" decoding="async" src="\./runs\.files/(\w+\.\w+)"', page)
    assert [kind for kind, _ in pictures] == ["photo", "film"]  # nothing of the damaged run
    assert {file.name for file in (runs / "runs.files").iterdir()} == {name for _, name in pictures}
    drawn = {file: file.stat().st_mtime_ns for file in (runs / "runs.files").iterdir()}
    assert write(runs, runs / "runs.html", films=True) == page
    assert {file: file.stat().st_mtime_ns for file in drawn} == drawn  # only new runs are drawn


def test_foreign_text_is_escaped_and_only_the_pages_script_may_run(runs: Path, tmp_path: Path) -> None:
    page = write(runs, tmp_path / "index.html")
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    assert f"script-src &#39;sha256-{digest}&#39;" in page and "default-src &#39;none&#39;" in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; the milk" in page and "<b>milk" not in page
    assert 'href="javascript' not in page and "javascript%3Aalert%283%29%22/" in page
    assert "/home/me" not in page and "<option>gantry.xml, suction</option>" in page


def test_a_link_in_the_place_of_the_pictures_is_not_followed(runs: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "index.files").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="is a link"):
        write(runs, tmp_path / "index.html")
    assert not list((tmp_path / "elsewhere").iterdir())
