"""``grs approve``: the graph with approval of the documentation waits for a person and goes on."""

import json
import re
from pathlib import Path

import pytest

from grs_agents.base import content
from tests.cli.command import grs

DOCS = Path(__file__).parents[2] / "docs" / "own_parts.md"


@pytest.fixture
def approving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A content folder with that graph, called ``approving``."""
    monkeypatch.setattr(content, "_overlays", [])
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    (source,) = [block for block in blocks if "def approve(" in block]
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "approving.py").write_text(source, encoding="utf-8")
    return tmp_path


def test_the_graph_with_approval_of_the_documentation(approving: Path, known_scene: Path) -> None:
    content_folder = ("--content", str(approving))
    order = ("run", str(known_scene), "--out", "r", "--set", "graph=approving", "--json")
    asked = grs(*content_folder, *order, folder=approving)
    assert asked.returncode == 4, asked.stderr
    assert json.loads(asked.stdout)["status"] == "waiting"
    assert f"to go on: grs --content {approving.resolve()} approve r --reply ..." in asked.stderr

    shown = grs(*content_folder, "approve", "r", folder=approving)
    assert shown.returncode == 4
    assert "Is this the task that you want?" in shown.stdout
    assert "choices: yes, no" in shown.stdout

    wrong = grs(*content_folder, "approve", "r", "--reply", "well", folder=approving)
    assert (wrong.returncode, "begin it with yes or no" in wrong.stderr) == (2, True)

    refused = grs(*content_folder, "approve", "r", "--reply", "no, too easy", "--json", folder=approving)
    assert refused.returncode == 1, refused.stderr
    assert "a person refused the task: no, too easy" in json.loads(refused.stdout)["reason"]

    late = grs(*content_folder, "approve", "r", "--reply", "yes", folder=approving)
    assert (late.returncode, "rejected and waits for no reply" in late.stderr) == (2, True)
