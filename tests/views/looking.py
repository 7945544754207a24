"""A real viewer without a display: opens recordings, goes to a moment, and is photographed."""

import contextlib
import os
import socket
import subprocess
import time
from collections.abc import Generator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from rerun.experimental import ViewerClient

from grs_agents.views.rerun.viewer import find_rerun_program, viewer_environment

PATIENCE = 90.0
Image = npt.NDArray[np.uint8]


def free_port() -> int:
    """A port that nothing listens to."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def headless(recording: Path) -> Generator[ViewerClient]:
    """A viewer of 1600 x 900 that has loaded ``recording``."""
    with viewer(recording) as url:
        yield connected(url)


@contextlib.contextmanager
def viewer(*recordings: Path) -> Generator[str]:
    """The address of a viewer of 1600 x 900 that opens ``recordings`` and waits for more."""
    port = free_port()
    command = [str(find_rerun_program()), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += [*map(str, recordings), "--window-size", "1600x900"]
    process = subprocess.Popen(command, env={**os.environ, **viewer_environment()}, stderr=subprocess.DEVNULL)
    try:
        yield f"rerun+http://127.0.0.1:{port}/proxy"
    finally:
        process.terminate()
        process.wait(30)


def connected(url: str) -> ViewerClient:
    """The viewer at ``url`` once it shows a run."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            client = ViewerClient.connect(url)
            recordings = client.get_state().recordings
            if recordings and "replay" in {timeline.name for timeline in recordings[0].timelines}:
                return client
        except Exception:
            if time.monotonic() > end:
                raise
        time.sleep(0.2)


def picture(client: ViewerClient, seconds: float) -> Image:
    """The whole viewer at a moment of the timeline ``replay``."""
    client.set_time("replay", duration=seconds, play_state="paused")
    before: Image | None = None
    end = time.monotonic() + PATIENCE
    while True:  # until two pictures in a row agree and show something
        try:
            data = np.frombuffer(client.take_screenshot(max_size=1600), np.uint8)
        except TimeoutError:  # drawn in software on a busy machine
            if time.monotonic() > end:
                raise
            continue
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
        if (before is not None and (image == before).all() and image.std() > 10) or time.monotonic() > end:
            return image
        before = image
        time.sleep(0.5)
