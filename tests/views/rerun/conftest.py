"""A recording that is closed whatever comes."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from grs_agents.views.rerun.recording import RerunRecording
from grs_agents.views.rerun.viewer_layout import build_run_blueprint


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[RerunRecording]:
    """Writes ``a.rrd``; a test that reads it closes it before."""
    with closing(RerunRecording(tmp_path / "a.rrd", "a", build_run_blueprint(("a",)))) as made:
        yield made
