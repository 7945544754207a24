"""``grs demos``."""

import re
from pathlib import Path
from typing import Final

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.sim.rendering.scene_cameras import CAMERAS
from grs_agents.sim.rendering.stage import LARGEST_PICTURE
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.dataset import check_format_requirements, write_dataset
from grs_agents.tasks.demos.hub import check_hub_requirements, push_dataset
from grs_agents.tasks.demos.production import DemoOrder, make_demonstrations
from grs_agents.tasks.demos.types import DEMO_CONTROLS, FORMATS, DemoControl, Format
from grs_agents.tasks.task_folder import DATASET_FILE, open_task_folder
from grs_agents.views.terminal import show_activity_status

_LEROBOT_CAMERAS: Final = ("front", "wrist")
"""Cameras of LeRobot data sets by default: ACT, SmolVLA and pi0 read every ``observation.images.*``. The other formats
have none, since they keep pictures whole: 45 MB an episode with robomimic."""
_NO_CAMERA: Final = "none"


def parse_demo_control(name: str) -> DemoControl:
    """The control ``name`` of actions. Raises UnknownNameError."""
    for known in DEMO_CONTROLS:
        if known == name:
            return known
    raise UnknownNameError("control", name, DEMO_CONTROLS)


def parse_format(name: str) -> Format:
    """The format ``name``. Raises UnknownNameError."""
    for known in FORMATS:
        if known == name:
            return known
    raise UnknownNameError("format", name, FORMATS)


def parse_cameras(text: str | None, kind: str) -> tuple[str, ...]:
    """The cameras of a list such as ``photo,front``; without one those by default of the format ``kind``.

    Raises UnknownNameError.
    """
    if text is None:
        return _LEROBOT_CAMERAS if kind == "lerobot" else ()
    if text.strip() == _NO_CAMERA:
        return ()
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names:
        if name not in CAMERAS:
            raise UnknownNameError("camera", name, (*CAMERAS, _NO_CAMERA))
    return names


def parse_size(text: str) -> tuple[int, int]:
    """Rows and columns of a size such as ``96x128``."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(0 < side <= LARGEST_PICTURE for side in size):
        raise InputError(
            f"--size {text!r} is no size of a picture", f"give ROWSxCOLUMNS, as 96x128; at most {LARGEST_PICTURE} each"
        )
    return size


def write_demonstrations(
    run: Path, order: DemoOrder, kind: str, out: Path | None, hub: str, private: bool, workers: int, as_json: bool
) -> int:
    """Make and write the demonstrations of a task, with a progress bar, and upload them to ``hub`` unless it is empty.

    Returns:
        Exit status, 1 if fewer than requested.
    """
    chosen = parse_format(kind)
    check_format_requirements(chosen, order)
    if hub:
        if chosen != "lerobot":
            raise InputError(f"--format {kind} holds paths of this machine", "upload with --format lerobot")
        check_hub_requirements(hub)
    folder = open_task_folder(run)
    out = out or run.resolve().with_name(f"{run.resolve().name}-demos")
    if hub and (out / DATASET_FILE).is_file():
        address = _upload(out, hub, private)
        if as_json:
            print_json({"out": str(out), "hub": address})
        else:
            print_escaped(f"{out} is at {address}")
        return 0
    if out.exists():
        raise InputError(f"{out} is there already", "name another folder with --out, or remove it")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.make_console(error=True)) as progress:
        row = progress.add_task("demonstrations", total=order.total)

        def update_demo_progress(store: AttemptStore) -> None:
            failed = len(store.attempts) - store.count
            dropped = f", {failed} dropped" if failed else ""
            progress.update(row, completed=store.count, description=f"demonstrations{dropped}")

        work = out.with_name(f"{out.name}-unfinished")
        store = make_demonstrations(folder, order, work, update_demo_progress, workers)
        progress.update(row, description=f"writing {kind}")
        summary = write_dataset(store, chosen, out, folder)
    address = _upload(out, hub, private) if hub else None
    if as_json:
        print_json({**summary.model_dump(mode="json"), **({"hub": address} if hub else {})})
    else:
        console = terminal.make_console()
        count = (
            str(summary.episodes) if summary.episodes == order.total else f"only {summary.episodes} of {order.total}"
        )
        line = f"{summary.out}: {count} episodes, {summary.steps} steps, format {summary.format}"
        console.print(Text(line, style="bold"))
        if summary.dropped:
            stages = ", ".join(f"{count} by the {stage}" for stage, count in summary.dropped.items())
            console.print(Text(f"  attempts without a demonstration: {stages}"))
        for reason in summary.reasons:
            console.print(Text(f"    {reason}"))
        console.print(Text(f"  open it with {summary.opens_with}"), soft_wrap=True)
        if hub:
            print_escaped(f"  uploaded to {address}")
    return 0 if summary.episodes == order.total else 1


def _upload(folder: Path, hub: str, private: bool) -> str:
    with show_activity_status(f"uploading to {hub}"):
        return push_dataset(folder, hub, private)
