"""Scene editors in the sandbox that the tests share."""

from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from grs_agents.base.config.load import load_config
from grs_agents.runs.scene_editor import SceneEditor, open_scene_editor
from tests.kept_sandbox import lend_sandbox


@contextmanager
def open_editor(source: Path, folder: Path) -> Generator[SceneEditor]:
    """Open a photo or scene for corrections."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("grs_agents.runs.execution.open_sandbox", lend_sandbox)
        patch.setattr("grs_agents.runs.scene_editor.open_sandbox", lend_sandbox)
        config = load_config(None, overrides={"graph": "scene"})
        with open_scene_editor(source, folder, config, lambda _, __: nullcontext()) as editor:
            yield editor
