"""A real viewer opens a recording and shows something."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import pytest

from grs_agents.library import Library
from grs_agents.views.rerun_view import rebuild
from grs_agents.views.viewer import rerun_program, viewer_environment

VULKAN_DRIVERS = [Path(root) / "vulkan" / "icd.d" for root in ("/usr/share", "/etc", "/usr/local/share")]


@pytest.mark.skipif(
    not any(list(folder.glob("*.json")) for folder in VULKAN_DRIVERS if folder.is_dir()),
    reason="no Vulkan driver: install mesa-vulkan-drivers",
)
def test_a_headless_viewer_draws_the_run(script: Callable[[], Any], library: Library, tmp_path: Path) -> None:
    run = script()
    run.before_fix()
    rebuild(run.folder, library)
    picture = tmp_path / "screenshot.png"
    command = [str(rerun_program()), "--headless", "--bind", "127.0.0.1", "--port", "auto"]
    command += [str(tmp_path / "trace.rrd"), "--window-size", "1600x900", "--screenshot-to", str(picture)]
    done = subprocess.run(command, env=viewer_environment(), capture_output=True, text=True, timeout=90, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    image = cv2.imread(str(picture))
    assert image is not None
    assert image.shape[1] * 9 == image.shape[0] * 16
    assert image.std() > 10
