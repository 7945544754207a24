"""Index of runs as an HTML page: cards with photo, twin, film, sentence and verdict, filters, two runs side by side.

Pictures are drawn anew from the run folders, which may be foreign, into a folder beside the page; the page loads
nothing else. Their names are hashes of their sources, so that a later call draws the new runs only. The script of the
page is its own and allowed by its hash, so that no other script runs even if escaping failed.
"""

import base64
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import cv2

from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import make_folder, refuse_link, unwritable_error, write_bytes
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.templates import load_template
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.film.rollout_film import (
    Take,
    draw_take_captions,
    encode_animation,
    make_film_take,
    make_rollout_shot,
    render_takes,
)

PICTURES: Final = (("photo", "scene/rgb.png"), ("twin", "scene/twin.png"))
_WIDTH: Final = 480
"""Pixels of a photo and its twin: side by side they are shown so wide at most."""
_FILM_SIZE: Final = (400, 300)
_RATE: Final = 6.0
"""Frames per second of a film."""
_LONGEST: Final = 30
"""Frames of a film; longer rollouts are shown faster. They cost 1.5 CPU seconds without a graphics card."""
_FILMS_TOGETHER: Final = 8
"""Films drawn by a process: its start costs as much as a film, an interruption loses them."""
_FIGURES: Final = ("objects", "code_fixes", "test_fixes", "task_fixes", "model_calls")


@dataclass(frozen=True)
class RunCard:
    """A run as the page shows it."""

    name: str
    url: str  # of its folder, relative to the page
    status: str
    robot: str  # arm and hand
    title: str  # name of the task
    words: str  # task description
    sentence: str  # goals in the words of GRS
    reason: str
    facts: tuple[tuple[str, str], ...]
    pictures: Mapping[str, str]  # URL by ``photo``, ``twin``, ``film``

    @property
    def text(self) -> str:
        """Text that the filter searches, in lower case."""
        return " ".join(
            (self.name, self.title, self.words, self.sentence, self.reason, *dict(self.facts).values())
        ).lower()


def write_runs_page(
    runs: Sequence[tuple[Path, Mapping[str, Any]]],
    page: Path,
    films: bool = True,
    show: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the page of run folders, each checked and with its record, to the file ``page``.

    Pictures go to the folder ``NAME.files`` beside it. A damaged file of a run costs its picture alone.

    Args:
        runs: folder and ``run.json`` of each run, in the order shown.
        page: the HTML file.
        films: draw a film of a rollout of each run, 1.5 CPU seconds each.
        show: receives a progress text.

    Raises:
        InputError: the page or a picture cannot be written.
    """
    files = refuse_link(page.with_name(f"{page.stem}.files"))
    try:
        make_folder(files)
    except OSError as error:
        raise unwritable_error(files, error) from error
    drawn: list[dict[str, str]] = []
    with decode_in_worker(*(folder for folder, _ in runs)):
        for number, (folder, _) in enumerate(runs, 1):
            show(f"pictures of run {number} of {len(runs)}")
            names = {kind: _save_thumbnail(folder, member, files) for kind, member in PICTURES}
            drawn.append({kind: name for kind, name in names.items() if name})
        if films:
            for (folder, _), pictures in zip(runs, drawn, strict=True):
                if name := _name_film(folder):
                    pictures["film"] = name
            _draw_films(
                {
                    pictures["film"]: folder
                    for (folder, _), pictures in zip(runs, drawn, strict=True)
                    if "film" in pictures
                },
                files,
                show,
            )
    cards = [
        _describe_run(folder, record, page, {kind: name for kind, name in pictures.items() if (files / name).is_file()})
        for (folder, record), pictures in zip(runs, drawn, strict=True)
    ]
    here = Path(__file__)
    script = here.with_name("page.js").read_text("utf-8")
    text = load_template(here.with_name("page.html")).render(
        policy=_make_policy(script),
        script=script,
        style=here.parents[1].joinpath("report", "style.css").read_text("utf-8"),
        cards=cards,
        statuses=sorted({card.status for card in cards}),
        robots=sorted({card.robot for card in cards}),
    )
    return write_bytes(page, text.encode("utf-8", "replace"))


def _make_policy(script: str) -> str:
    """A content security policy that allows the pictures beside the page, and the script alone by its hash."""
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; img-src 'self' file:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; "
        "base-uri 'none'; form-action 'none'"
    )


def _save_thumbnail(folder: Path, member: str, files: Path) -> str:
    """Save a picture of a run, reduced, as a JPEG among ``files``. Returns: its name; empty without a picture."""
    try:
        source = find_member_file(folder, member)
        if source is None:
            return ""
        name = f"{sha256(read_bytes(source)).hexdigest()[:24]}.jpg"
        if not _is_drawn(files / name):
            image = read_picture(source, cv2.IMREAD_COLOR)
            scale = min(1.0, _WIDTH / image.shape[1])
            small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            write_bytes(files / name, cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 82])[1].tobytes())
    except (InputError, cv2.error):  # torn, or a single row of pixels
        return ""
    return name


def _is_drawn(file: Path) -> bool:
    return file.is_file() and not file.is_symlink()


def _name_film(folder: Path) -> str:
    """Name of the film of a run; empty without events. It changes with them."""
    try:
        events = find_member_file(folder, "events.jsonl")
        return "" if events is None else f"{sha256(read_bytes(events)).hexdigest()[:24]}.webp"
    except InputError:
        return ""


def _draw_films(folders: Mapping[str, Path], files: Path, show: Callable[[str], None]) -> None:
    """Draw the films that are missing among ``files``, several by a process; a run that cannot be drawn gets none."""
    takes: list[tuple[str, Take]] = []
    for name, folder in folders.items():
        if _is_drawn(files / name):
            continue
        try:
            shot = make_rollout_shot(folder, None, _FILM_SIZE)
            rate = min(_RATE, _LONGEST / max(shot.recorded_motion.duration_seconds, 1.0))
            takes.append((name, make_film_take(shot, rate)))
        except GrsError:  # no task was played, or its files are damaged
            continue
    for first in range(0, len(takes), _FILMS_TOGETHER):
        show(f"film {first + 1} of {len(takes)}")
        together = takes[first : first + _FILMS_TOGETHER]
        try:
            _draw_together(together, files)
        except GrsError:  # of one of them
            for take in together:
                try:
                    _draw_together([take], files)
                except GrsError:
                    continue


def _draw_together(takes: Sequence[tuple[str, Take]], files: Path) -> None:
    images = render_takes([take for _, take in takes])
    for name, take in takes:
        frames = list(draw_take_captions(take, islice(images, len(take[1]))))
        write_bytes(files / name, encode_animation(frames, _RATE, "webp"))


def _describe_run(folder: Path, record: Mapping[str, Any], page: Path, pictures: Mapping[str, str]) -> RunCard:
    config: Mapping[str, Any] = record["config"]
    counts: Mapping[str, int] = record["counts"]
    try:
        task = read_json(folder / "task.json", "") if find_member_file(folder, "task.json") else {}
    except InputError:
        task = {}
    rewards: Sequence[float] = record["rewards"]
    facts = {
        "scene": Path(record["source"]).name,
        "graph": record["graph"],
        "robot": _describe_robot(config),
        "seed": str(config.get("seed", "")),
        "corrections": str(len(record.get("edits", ())) or ""),
        **{name.replace("_", " "): str(counts[name]) for name in _FIGURES if name in counts},
        "rewards": ", ".join(f"{reward:.2f}" for reward in rewards),
        "seconds": f"{record['seconds'].get('total', 0.0):.1f}",
        "cost": "" if record["cost"] is None else f"${record['cost']:.2f}",
    }
    place = os.path.relpath(folder.resolve(), page.resolve().parent)
    base = quote(f"{page.stem}.files")
    return RunCard(
        name=folder.resolve().name,
        url=f"./{quote(Path(place).as_posix())}/",
        status=record["status"],
        robot=_describe_robot(config),
        title=str(task.get("task-name", "")).replace("-", " ") or f"scene {facts['scene']}",
        words=str(task.get("task-description", "")),
        sentence=record["sentence"],
        reason=record["reason"],
        facts=tuple((name, value) for name, value in facts.items() if value),
        pictures={kind: f"./{base}/{name}" for kind, name in pictures.items()},
    )


def _describe_robot(config: Mapping[str, Any]) -> str:
    """Arm and hand of a configuration; of a file its name."""
    names = (Path(str(config[key])).name for key in ("robot", "hand") if config.get(key))
    return ", ".join(names)
