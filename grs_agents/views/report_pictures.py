"""The pictures of a report: the photo with its boxes, its twin, and the rollouts from beginning to end."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.errors import GrsError
from grs_agents.library import Library
from grs_agents.trace import Event, NodeStarted, Rollout, SceneStage
from grs_agents.views.film import Shot, pictures
from grs_agents.views.objects import Rectangle, label_of, name_of, rectangles
from grs_agents.views.page import paragraph, picture, table
from grs_agents.views.twin import twin_objects, twin_picture

FRAMES = 6
"""Pictures of a film strip."""


@dataclass(frozen=True)
class Sources:
    """Where pictures come from.

    Attributes:
        folder: the run.
        library: 3D assets, the run's own laid over.
        robot: name of the arm, or its file.
    """

    folder: Path
    library: Library
    robot: str = "ur5e"


def photo(events: Sequence[Event], sources: Sources) -> Iterator[str]:
    """The photo with a numbered box around each object, the twin beside it, and the objects as a table."""
    files: dict[str, str] = {}
    camera: dict[str, Any] = {}
    objects: list[dict[str, Any]] = []
    background: str | None = None
    for event in events:
        if isinstance(event, SceneStage):
            files.update(event.files)
            camera.update(event.summary.get("camera") or {})
            objects = event.summary.get("objects") or objects
            background = event.summary.get("background") or background
    shown = [_photo(files, objects, sources.folder), _twin(objects, camera, background, sources.library)]
    if any(shown):
        yield f'<div class="row">{"".join(shown)}</div>'
    if objects:
        yield table(["", "name", "size (cm)", "asset", "description"], [_row(*one) for one in enumerate(objects)], (0,))


def _row(index: int, item: dict[str, Any]) -> tuple[object, ...]:
    size = ""
    if item.get("box"):
        extents = np.subtract(item["box"]["high"], item["box"]["low"]) * 100
        size = " x ".join(f"{extent:.1f}" for extent in extents)
    return label_of(item, index), name_of(item), size, item.get("asset") or "", item.get("description") or ""


def _photo(files: dict[str, str], objects: Sequence[dict[str, Any]], folder: Path) -> str:
    import cv2

    image = cv2.imread(str(folder / files["rgb"]), cv2.IMREAD_COLOR) if "rgb" in files else None
    if image is None:
        return ""
    labels = cv2.imread(str(folder / files["masks"]), cv2.IMREAD_UNCHANGED) if "masks" in files else None
    numbers = {label_of(item, index) for index, item in enumerate(objects)}
    boxes = rectangles(labels) if labels is not None and labels.shape == image.shape[:2] else {}
    marks: list[tuple[str, Rectangle]] = [(str(label), box) for label, box in boxes.items() if label in numbers]
    return picture(np.asarray(image[:, :, ::-1], dtype=np.uint8), "The photo, with the objects found in it", marks)


def _twin(objects: Sequence[dict[str, Any]], camera: dict[str, Any], background: str | None, library: Library) -> str:
    if not camera.get("T_robot_cam"):
        return ""
    try:
        things = twin_objects(objects, library)
        image = twin_picture(things, library, camera, background) if things else None
    except GrsError as error:
        return paragraph(f"The twin cannot be drawn: {error}", "quiet")
    return "" if image is None else picture(image, "The same view of the simulated scene")


def rollouts(events: Sequence[Event], sources: Sources) -> Iterator[str]:
    """Each rollout of the last audit: before, after and its figures; of the first one a film strip."""
    found: list[Rollout] = []
    for event in events:
        if isinstance(event, NodeStarted) and event.node == "audit":
            found.clear()
        elif isinstance(event, Rollout):
            found.append(event)
    for event in found:
        verdict = f"Seed {event.seed}: {event.outcome}, reward {event.reward:.2f} after {event.steps} steps; "
        yield paragraph(
            f"{verdict}doing nothing earns {event.idle_reward:.2f}; moved {', '.join(event.moved) or 'nothing'}"
        )
        present = event.recording and event.instance and (sources.folder / event.recording).is_file()
        yield from _stills(event, sources, strip=event is found[0]) if present else ()


def _stills(event: Rollout, sources: Sources, strip: bool) -> Iterator[str]:
    shot = Shot(sources.folder.resolve(), event, sources.library, sources.robot)
    try:
        end = shot.motion.seconds
        moments = [0.0, end, *(np.linspace(0, end, FRAMES).tolist() if strip else ())]
        drawn = list(pictures(shot, moments))
    except GrsError as error:
        yield paragraph(f"There is no picture of it: {error}", "quiet")
        return
    yield f'<div class="row">{picture(drawn[0], "before")}{picture(drawn[1], f"after {end:.1f} s")}</div>'
    small = [image[::2, ::2] for image in drawn[2:]]
    if small:
        frames = (picture(image, f"{seconds:.1f} s") for image, seconds in zip(small, moments[2:], strict=True))
        yield f'<div class="strip">{"".join(frames)}</div>'
