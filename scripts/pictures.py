"""Renew the pictures of the documentation: `.venv/bin/python scripts/pictures.py`; needs a Vulkan driver.

Two runs on the sample scene are made and photographed in rerun's viewer; the first is also filmed, as by `grs
report RUN --out film.webp`. A digest of their inputs is stored beside them; `tests/test_docs.py` compares it,
without a viewer, and reports outdated pictures.
"""

import hashlib
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
FILM = IMAGES / "film.webp"
DIGEST = IMAGES / "pictures.sha256"
SIZE = "1600x900"
MENU = 36
"""Pixels of the viewer's own bar, whose warnings are about the machine that the pictures are made on."""
FIXES = 10
"""Number of corrections to the model of the second run."""
PATIENCE = 90.0


@dataclass(frozen=True)
class Picture:
    """A picture of a run.

    Attributes:
        name: of the file.
        tab: of the viewer, by its heading.
        event: index among all events of its kind, or the end of the run.
        later: seconds of the film after it.
    """

    name: str
    tab: str
    event: tuple[str, int] | None = None
    later: float = 0.05


ACCEPTED = (Picture("trace", "Overview", ("rollout", 1), 2.0), Picture("scene", "1 Scene"))
FIXED = (Picture("fixes", "3 Tests and fixes", ("decision", -1)),)


def digest() -> str:
    """The SHA-256 of the pictured things: the layout of the views, the state machine, the sample scene, rerun."""
    from grs_agents.base import content
    from grs_agents.views.rerun.state_machine_view import node_positions
    from grs_agents.views.rerun.viewer_layout import build_run_blueprint

    sha = hashlib.sha256(f"{version('rerun-sdk')}\n".encode())
    sha.update(f"{node_positions(content.load_module('graphs', 'grs').build().nodes)}\n".encode())
    layout = build_run_blueprint(("a", "b"))
    sha.update(f"{layout.time_panel and vars(layout.time_panel)}\n".encode())
    for line in _layout(layout.root_container):
        sha.update(f"{line}\n".encode())
    for file in sorted(content.sample_scenes()["groceries"].iterdir()):
        sha.update(file.read_bytes())
    return sha.hexdigest()


def _layout(part: Any) -> Iterator[str]:
    """A view or container and all that is in it, a line each, without the ids that change every time."""
    contents: Any = part.contents or []
    children: list[Any] = [contents] if isinstance(contents, str) else list(contents)
    paths = [str(child) for child in children if isinstance(child, str)]
    kind = getattr(part, "class_identifier", None) or part.kind
    shares = [getattr(part, name, None) for name in ("column_shares", "row_shares", "active_tab")]
    yield f"{kind} {part.name} {getattr(part, 'origin', '')} {paths} {shares}"
    for child in children:
        if not isinstance(child, str):
            yield from _layout(child)


def shoot(run: Path, pictures: tuple[Picture, ...]) -> None:
    """Write the pictures of a run."""
    moments = moments_of(run)
    with _viewer(run / "trace.rrd") as viewer:
        for wanted in pictures:
            _choose(viewer, wanted.tab)
            if wanted.event is None:
                viewer.set_time("replay", play_state="following")
            else:
                kind, number = wanted.event
                viewer.set_time("replay", duration=moments[kind][number] + wanted.later, play_state="paused")
            file = IMAGES / f"{wanted.name}.png"
            with Image.open(BytesIO(_still(viewer))) as picture:
                shown = picture.crop((0, MENU, *picture.size))
                few = shown.convert("RGB").quantize(256, kmeans=4, dither=Image.Dither.NONE)
            few.save(file, optimize=True)
            print(f"{file}: {file.stat().st_size // 1024} KiB")


@contextmanager
def _viewer(trace: Path) -> Generator[Any]:
    """A viewer without a window, on this machine alone, that shows a recording."""
    from rerun.experimental import ViewerClient

    from grs_agents.views.rerun.viewer import LOOPBACK, WebAddress, find_rerun_program, viewer_environment

    port = WebAddress.with_free_ports().data
    command = [str(find_rerun_program()), "--headless", "--bind", LOOPBACK, "--port", str(port), str(trace)]
    command += ["--window-size", SIZE]
    process = subprocess.Popen(command, env=viewer_environment(), stderr=subprocess.DEVNULL)
    try:
        end = time.monotonic() + PATIENCE
        while True:
            try:
                viewer = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
                if viewer.get_state().recordings:
                    break
            except (RuntimeError, OSError, ConnectionError):
                if time.monotonic() > end:
                    raise
            time.sleep(0.2)
        yield viewer
    finally:
        process.terminate()
        process.wait()


def _choose(viewer: Any, heading: str) -> None:
    """Bring a tab to the front."""
    shown = viewer.get_blueprint("recording").blueprint
    boxes = {path: parts["ContainerBlueprint"] for path, parts in shown.items() if "ContainerBlueprint" in parts}
    (tab,) = [path for path, box in boxes.items() if box.get("display_name") == heading]
    (around,) = [box for box in boxes.values() if tab in box["contents"]]
    around["active_tab"] = tab
    viewer.set_blueprint(shown, "recording")


def _still(viewer: Any) -> bytes:
    """The whole viewer once two pictures in a row agree."""
    time.sleep(2.0)
    before, end = b"", time.monotonic() + PATIENCE
    while True:
        try:
            now = bytes(viewer.take_screenshot(max_size=1600))
        except TimeoutError:  # drawn in software on a busy machine
            if time.monotonic() > end:
                raise
            continue
        if now == before or time.monotonic() > end:
            return now
        before = now
        time.sleep(1.0)


def moments_of(folder: Path) -> dict[str, list[float]]:
    """Time of each event of a run on the timeline ``replay``, by kind, s."""
    from grs_agents.base.trace.events import Rollout
    from grs_agents.base.trace.log import read_events
    from grs_agents.views.rerun.recording import Clock
    from grs_agents.views.rerun.rollout_view import rollout_duration

    clock, moments = Clock(), defaultdict[str, list[float]](list)
    for event in read_events(folder / "events.jsonl"):
        moments[event.kind].append(clock.advance_to_event(event).replay)
        if isinstance(event, Rollout):
            clock.advance_by_seconds(rollout_duration(folder, event))
    return moments


def main() -> int:
    """Make two runs and their pictures, and store the digest."""
    from grs_agents.base import content
    from grs_agents.base.config.load import load_config
    from grs_agents.runs.execution import execute_run
    from grs_agents.runs.run_opening import RunOrder
    from grs_agents.views.film.rollout_film import make_rollout_shot, write_film
    from grs_agents.views.live_views import attach_live_views

    scene, config = content.sample_scenes()["groceries"], load_config()
    with tempfile.TemporaryDirectory() as temporary:
        accepted, fixed = Path(temporary) / "groceries", Path(temporary) / "fixed"
        if status := execute_run(RunOrder("run", scene, config, accepted), attach_live_views).record.exit_status:
            return status
        shoot(accepted, ACCEPTED)
        frames = write_film(make_rollout_shot(accepted), FILM)
        print(f"{FILM}: {FILM.stat().st_size // 1024} KiB, {frames} pictures")
        fixed.mkdir()
        content.load_module("evals", "trace_cost").measure(scene, fixed, FIXES, config.config)
        shoot(fixed, FIXED)
    DIGEST.write_text(f"{digest()}\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
