"""A real browser without a display, driven over WebDriver: what a page looks like once it has been drawn."""

import base64
import contextlib
import json
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Callable, Generator
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tests.views.looking import free_port

# Rerun draws with WebGL, here in software; the rest keeps Chromium from looking for its maker's servers.
_ARGUMENTS = """
    --headless --no-sandbox --disable-quic --no-first-run --disable-background-networking
    --disable-component-update --disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader
    --window-size=800,500
"""
PATIENCE = 200.0
Image = npt.NDArray[np.uint8]


@contextlib.contextmanager
def browser() -> Generator[Callable[..., Any]]:
    """A browser with one empty page; call it with a method, what is below the session's path, and a body."""
    port = free_port()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL)
        root = f"http://127.0.0.1:{port}"
        try:
            _wait_until(lambda: _ask("GET", f"{root}/status")["ready"])
            options = {"args": [*_ARGUMENTS.split(), f"--user-data-dir={profile}"]}
            wanted = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": options}}}
            session = f"{root}/session/{_ask('POST', f'{root}/session', wanted)['sessionId']}"
            try:
                yield lambda method, path, body=None: _ask(method, f"{session}/{path}", body)
            finally:  # else the browser outlives its driver
                _ask("DELETE", session)
        finally:
            process.terminate()
            process.wait(30)


def page_once(url: str, drawn: Callable[[Image], bool]) -> Image:
    """What the page at ``url`` looks like once it is ``drawn``, or when patience is at its end."""
    with browser() as call:
        call("POST", "url", {"url": url})
        image = np.zeros((1, 1, 3), np.uint8)
        end = time.monotonic() + PATIENCE
        while not drawn(image) and time.monotonic() < end:
            with contextlib.suppress(OSError):  # a page that is drawn in software may take too long for one picture
                data = np.frombuffer(base64.b64decode(call("GET", "screenshot")), np.uint8)
                image = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
            time.sleep(0.5)
        return image


def _wait_until(ready: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while True:
        try:
            if ready():
                return
        except OSError:
            if time.monotonic() > end:
                raise
        time.sleep(0.1)


def _ask(method: str, url: str, body: Any = None) -> Any:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=90) as reply:
        return json.load(reply)["value"]
