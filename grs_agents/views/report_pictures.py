"""The pictures of a report: the photo with its boxes, its twin, and the rollouts from beginning to end."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.errors import GrsError, InputError
from grs_agents.foreign import present
from grs_agents.foreign.pictures import read_picture
from grs_agents.library import Library
from grs_agents.sim.instance.instance import TaskInstance
from grs_agents.trace import Event, NodeStarted, Rollout, SceneStage
from grs_agents.views.common.run_objects import twin_objects, twin_picture
from grs_agents.views.common.scene_objects import Rectangle, label_of, name_of, rectangles
from grs_agents.views.film.film import Shot, pictures
from grs_agents.views.page import paragraph, picture, table

FRAMES = 6
"""Pictures of a film strip."""


@dataclass(frozen=True)
class Sources:
    """Where pictures come from.

    Attributes:
        folder: the run.
        library: 3D assets, the run's own laid over.
        robot: name of the arm, or its file.
        show: is told what is drawn next.
    """

    folder: Path
    library: Library
    robot: str = "ur5e"
    show: Callable[[str], None] | None = None

    def drawing(self, what: str) -> None:
        """Say what is drawn next."""
        if self.show is not None:
            self.show(f"drawing {what}")


def photo(events: Sequence[Event], sources: Sources) -> Iterator[str]:
    """The photo with a numbered box around each object, the simulation beside it, and the objects as a table."""
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
    sources.drawing("the camera's view of the simulation")
    shown = [_photo(files, objects, sources.folder), _simulated(events, sources, objects, camera, background)]
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

    file = present(folder, files["rgb"]) if "rgb" in files else None
    if file is None:
        return ""
    image = read_picture(file, cv2.IMREAD_COLOR)
    drawn = present(folder, files["masks"]) if "masks" in files else None
    labels = read_picture(drawn, cv2.IMREAD_UNCHANGED) if drawn is not None else None
    numbers = {label_of(item, index) for index, item in enumerate(objects)}
    boxes = rectangles(labels) if labels is not None and labels.shape == image.shape[:2] else {}
    marks: list[tuple[str, Rectangle]] = [(str(label), box) for label, box in boxes.items() if label in numbers]
    return picture(np.asarray(image[:, :, ::-1], dtype=np.uint8), "The photo, with the objects found in it", marks)


def _simulated(
    events: Sequence[Event],
    sources: Sources,
    objects: Sequence[dict[str, Any]],
    camera: dict[str, Any],
    background: str | None,
) -> str:
    """The task as the camera of the photo would see it; of a run that came to none, the objects found."""
    if not camera.get("T_robot_cam"):
        return ""
    played = [event for event in last_rollouts(events) if event.instance]
    try:
        if played:
            instance = read_instance(sources.folder, played[0])
            things, background = list(instance.objects), instance.background
            caption = f"The same view of the task, seed {instance.seed}, before the robot moves"
        else:
            things = twin_objects(objects, sources.library)
            caption = "The same view of what was found: the asset that stands for each object"
        image = twin_picture(things, sources.library, camera, background) if things else None
    except GrsError as error:
        return paragraph(f"The simulation cannot be drawn: {error}", "quiet")
    return "" if image is None else picture(image, caption)


def last_rollouts(events: Sequence[Event]) -> list[Rollout]:
    """The rollouts of the last audit."""
    found: list[Rollout] = []
    for event in events:
        if isinstance(event, NodeStarted) and event.node == "audit":
            found.clear()
        elif isinstance(event, Rollout):
            found.append(event)
    return found


def read_instance(folder: Path, event: Rollout) -> TaskInstance:
    """The task that a rollout solved.

    Raises:
        InputError: its file is missing or damaged.
    """
    file = folder / (event.instance or "")
    try:
        return TaskInstance.model_validate_json(file.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{file} is no task instance: {error}", "make the run again") from error


def rollouts(events: Sequence[Event], sources: Sources) -> Iterator[str]:
    """Each rollout of the last audit: before, after and its figures; of the first one a film strip."""
    found = last_rollouts(events)
    for event in found:
        verdict = f"Seed {event.seed}: {event.outcome}, reward {event.reward:.2f} after {event.steps} steps; "
        yield paragraph(
            f"{verdict}doing nothing earns {event.idle_reward:.2f}; moved {', '.join(event.moved) or 'nothing'}",
            "" if event.outcome == "success" else "bad",
        )
        drawn = event.instance and event.recording and present(sources.folder, event.recording)
        yield from _stills(event, sources, strip=event is found[0]) if drawn else ()


def _stills(event: Rollout, sources: Sources, strip: bool) -> Iterator[str]:
    sources.drawing(f"the rollout of seed {event.seed}")
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
