"""The notebook of the documentation runs from top to bottom in a kernel of its own."""

import json
import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.needs import needs

NOTEBOOK = Path(__file__).parents[1] / "docs" / "tour.ipynb"


def printed(cell: Any) -> str:
    """What a cell has printed."""
    return "".join(output.get("text", "") for output in cell.get("outputs", ()))


@needs("gymnasium")
def test_the_notebook_runs_from_top_to_bottom(
    sample_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(NOTEBOOK.parents[1]), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "clear its outputs before you keep it"
    first, *_ = (cell for cell in notebook.cells if cell.cell_type == "code")
    assert '"groceries"' in first.source
    first.source = first.source.replace('"groceries"', repr(str(sample_run)))  # whose scene is known
    NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    told = "".join(printed(cell) for cell in notebook.cells)
    assert told.startswith("accepted\n")
    random, scripted = (line.split(" ", 1) for line in told.splitlines() if "_policy" in line)
    assert (random[0], scripted[0]) == ("random_policy", "scripted_policy")
    assert not any(json.loads(random[1].lower()))
    assert json.loads(scripted[1].lower()) == [True] * 4
    pictures = [
        kind for cell in notebook.cells for output in cell.get("outputs", ()) for kind in output.get("data", ())
    ]
    assert pictures.count("image/png") >= 3 and "image/webp" in pictures
