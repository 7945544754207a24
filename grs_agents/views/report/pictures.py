"""Pictures of a report: photo with boxes, photo over twin, the task from the photo's camera, and the rollouts of the
last audit with a film."""

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import GrsError
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.base.foreign.run_folder import find_member_file, resolve_member_file
from grs_agents.base.trace.events import Event, Finding, NodeStarted, Rollout, SceneStage
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.sim.rendering.cameras import resize_lens
from grs_agents.sim.rendering.pictures import render_from_camera
from grs_agents.sim.rendering.stage import scene_props_from_instance
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from grs_agents.views.common.rollout_motion import read_task_instance
from grs_agents.views.common.scene_objects import (
    Rectangle,
    format_object_size,
    mask_bounding_boxes,
    object_display_name,
    object_mask_label,
)
from grs_agents.views.film.rollout_film import (
    RolloutShot,
    Take,
    draw_take_captions,
    encode_animation,
    make_film_take,
    render_takes,
)

AuditEvent = TypeVar("AuditEvent", Rollout, Finding)
Image = npt.NDArray[np.uint8]
FILM_RATE = 8.0
"""Frame rate of the film, 1/s, reduced where it would exceed ``_MOST_PICTURES`` frames."""
_MOST_PICTURES = 96
_FILM_SIZE = (560, 420)
"""Width and height of film and stills, pixels."""
_VIEW_WIDTH = 640
"""Width of the task view, pixels."""


@dataclass(frozen=True)
class Sources:
    """Sources of pictures."""

    folder: Path
    library: Library  # 3D assets, the run's own laid over
    show: Callable[[str], None] | None = None  # receives a progress text

    def report_drawing_progress(self, subject: str) -> None:
        """Report that ``subject`` is being drawn."""
        if self.show is not None:
            self.show(f"drawing {subject}")


@dataclass(frozen=True)
class DrawnRollout:
    """A rollout with the images of a film, or the first and the last image."""

    event: Rollout
    images: list[Image] = field(default_factory=list[Image])
    rate: float = 0.0  # frames per second of a film; 0 if it is none
    problem: str = ""  # reason for missing images

    @property
    def summary(self) -> str:
        """Outcome, cause, reward and moved objects."""
        event = self.event
        cause = f" ({event.cause})" if event.cause else ""
        verdict = f"Seed {event.seed}: {event.outcome}{cause}, reward {event.reward:.2f} after {event.steps} steps; "
        return f"{verdict}doing nothing earns {event.idle_reward:.2f}; moved {', '.join(event.moved) or 'nothing'}"

    @property
    def stills(self) -> "list[Picture]":
        """The first and the last image; empty without images."""
        if not self.images:
            return []
        ends = ((self.images[0], "before"), (self.images[-1], "after"))
        return [make_picture(image, f"{name}, seed {self.event.seed}") for image, name in ends]


@dataclass(frozen=True)
class _DrawingPlan:
    """The frames to draw of a rollout."""

    take: Take
    rate: float = 0.0  # frames per second of a film; 0 if it is none

    def finish(self, images: Iterator[Image]) -> DrawnRollout:
        """The rollout with its images; those of a film get captions."""
        captioned = draw_take_captions(self.take, images) if self.rate else images
        return DrawnRollout(self.take[0].event, list(captioned), self.rate)


def last_audit_events(events: Sequence[Event], kind: type[AuditEvent]) -> list[AuditEvent]:
    """Rollouts or findings of the last audit; rollouts also of the node ``conclude``."""
    nodes = ("audit", "conclude") if kind is Rollout else ("audit",)
    starts = [at for at, event in enumerate(events) if isinstance(event, NodeStarted) and event.node in nodes]
    for at in reversed(starts or [0]):
        judged = [event for event in events[at:] if isinstance(event, Rollout | Finding)]
        if judged:
            return [event for event in judged if isinstance(event, kind)]
    return []


def draw_last_audit_rollouts(events: Sequence[Event], sources: Sources) -> list[DrawnRollout]:
    """The rollouts of the last audit; the first failed rollout, or else the first, as a film."""
    rollouts = last_audit_events(events, Rollout)
    failed = (event for event in rollouts if event.cause or event.outcome != "success")
    filmed = next(failed, next(iter(rollouts), None))
    planned = [_plan_rollout(event, sources, event is filmed) for event in rollouts]
    sources.report_drawing_progress(f"{len(rollouts)} rollouts")
    drawn = iter(_draw_planned_rollouts([plan for plan in planned if not isinstance(plan, DrawnRollout)]))
    return [plan if isinstance(plan, DrawnRollout) else next(drawn) for plan in planned]


def _plan_rollout(event: Rollout, sources: Sources, filmed: bool) -> _DrawingPlan | DrawnRollout:
    """The frames to draw of a rollout, or the rollout without images."""
    if not (event.instance and event.recording and find_member_file(sources.folder, event.recording)):
        return DrawnRollout(event)
    shot = RolloutShot(sources.folder.resolve(), event, sources.library, *_FILM_SIZE)
    try:
        seconds = shot.recorded_motion.duration_seconds
    except GrsError as error:
        return DrawnRollout(event, problem=str(error))
    if not filmed:
        return _DrawingPlan((shot, [0.0, seconds]))
    rate = min(FILM_RATE, _MOST_PICTURES / max(seconds, 1.0))
    return _DrawingPlan(make_film_take(shot, rate), rate)


def _draw_planned_rollouts(plans: Sequence[_DrawingPlan]) -> list[DrawnRollout]:
    """Draw the rollouts in a single process; if it fails, each in a process of its own."""
    try:
        images = render_takes([plan.take for plan in plans]) if plans else iter(())
        return [plan.finish(islice(images, len(plan.take[1]))) for plan in plans]
    except GrsError as error:
        if len(plans) == 1:
            return [DrawnRollout(plans[0].take[0].event, problem=str(error))]
        return [drawn for plan in plans for drawn in _draw_planned_rollouts([plan])]


@dataclass(frozen=True)
class Picture:
    """A picture within the page."""

    url: str
    width: int
    height: int
    caption: str
    marks: Sequence[tuple[str, Rectangle]] = ()  # named boxes drawn over it, pixels
    film: str = ""  # URL of an animation, which the picture replaces in print and under reduced motion
    twin: str = ""  # URL of the picture under it


def make_picture(image: Image, caption: str, marks: Sequence[tuple[str, Rectangle]] = ()) -> Picture:
    """An image (H, W, 3) within the page, with named boxes (pixels) drawn over it."""
    return Picture(_encode_as_url(image), image.shape[1], image.shape[0], caption, marks)


def _encode_as_url(image: Image) -> str:
    """An image (H, W, 3), red first, as the data URL of a JPEG."""
    import cv2

    bgr = np.ascontiguousarray(image[:, :, ::-1])
    jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"


def make_film(drawn: Sequence[DrawnRollout], reason: str = "") -> Picture | None:
    """The filmed rollout; None without a film. ``reason`` is that of a rejected run."""
    for item in drawn:
        if item.rate and item.images:
            film = base64.b64encode(encode_animation(item.images, item.rate, "webp")).decode()
            caption = f"The oracle at the task, seed {item.event.seed}: {reason or item.event.outcome}"
            return replace(make_picture(item.images[-1], caption), film=f"data:image/webp;base64,{film}")
    return None


@dataclass
class PhotoParts:
    """Files, camera and objects of the scene stages."""

    files: dict[str, str] = field(default_factory=dict[str, str])
    camera: dict[str, Any] = field(default_factory=dict[str, Any])
    objects: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])


def merge_scene_stage_summaries(events: Sequence[Event]) -> PhotoParts:
    """Merge the scene stages; later stages override earlier stages."""
    parts = PhotoParts()
    for event in events:
        if isinstance(event, SceneStage):
            parts.files.update(event.files)
            parts.camera.update(event.summary.get("camera") or {})
            parts.objects = event.summary.get("objects") or parts.objects
    return parts


def describe_objects(events: Sequence[Event], photo: PhotoParts, folder: Path) -> list[tuple[object, ...]]:
    """Rows of the photo's objects: label, name, size, asset, description, part in the task."""
    bystanders = _find_bystander_labels(events, folder) if photo.objects else {}
    return [
        (
            object_mask_label(item, index),
            object_display_name(item),
            format_object_size(item),
            item.get("asset") or "",
            item.get("description") or "",
            bystanders.get(index, ""),
        )
        for index, item in enumerate(photo.objects)
    ]


def _find_bystander_labels(events: Sequence[Event], folder: Path) -> dict[int, str]:
    """Labels of the scene objects, by list index, that no goal of the last audited task involves."""
    instances = [event.instance for event in last_audit_events(events, Rollout) if event.instance]
    try:
        objects = read_task_instance(resolve_member_file(folder, instances[0])).objects if instances else ()
    except GrsError:  # reported in place of the task's picture
        return {}
    return {
        item.id - FIRST_BYSTANDER: "fixed bystander" if item.category == "fixed" else "bystander"
        for item in objects
        if item.role == "bystander"
    }


def make_annotated_photo(photo: PhotoParts, folder: Path) -> Picture | None:
    """The photo with numbered boxes around its objects; None without a photo."""
    import cv2

    file = find_member_file(folder, photo.files["rgb"]) if "rgb" in photo.files else None
    if file is None:
        return None
    image = read_picture(file, cv2.IMREAD_COLOR)
    drawn = find_member_file(folder, photo.files["masks"]) if "masks" in photo.files else None
    labels = read_picture(drawn, cv2.IMREAD_UNCHANGED) if drawn is not None else None
    numbers = {object_mask_label(item, index) for index, item in enumerate(photo.objects)}
    boxes = mask_bounding_boxes(labels) if labels is not None and labels.shape == image.shape[:2] else {}
    marks: list[tuple[str, Rectangle]] = [(str(label), box) for label, box in boxes.items() if label in numbers]
    return make_picture(np.asarray(image[:, :, ::-1], np.uint8), "The photo, with the objects found in it", marks)


def make_photo_over_twin(files: dict[str, str], folder: Path) -> Picture | None:
    """The photo over its twin, up to a draggable edge, in print side by side; None without a twin."""
    import cv2

    paths = [find_member_file(folder, files[name]) if name in files else None for name in ("rgb", "twin")]
    if paths[0] is None or paths[1] is None:
        return None
    photo, twin = (
        np.asarray(read_picture(file, cv2.IMREAD_COLOR)[:, :, ::-1], np.uint8) for file in paths if file is not None
    )
    photo = np.asarray(cv2.resize(photo, twin.shape[1::-1], interpolation=cv2.INTER_AREA), np.uint8)
    caption = "The photo (left) and its twin in MuJoCo: drag the corner of the photo"
    return replace(make_picture(photo, caption), twin=_encode_as_url(twin))


def draw_task_view(events: Sequence[Event], sources: Sources, camera: dict[str, Any]) -> tuple[Picture | None, str]:
    """The task from the photo's camera, None for a run without rollouts, and the reason why it cannot be drawn."""
    played = [event for event in last_audit_events(events, Rollout) if event.instance]
    if not played or not camera.get("T_robot_cam"):
        return None, ""
    try:
        instance = read_task_instance(resolve_member_file(sources.folder, played[0].instance or ""))
        lens = Lens(**{name: camera[name] for name in ("fx", "fy", "cx", "cy", "width", "height")})
        small = resize_lens(lens, round(_VIEW_WIDTH * lens.height / lens.width), _VIEW_WIDTH)
        props = replace(scene_props_from_instance(instance), arm=None)
        picture = render_from_camera(props, sources.library, small, np.asarray(camera["T_robot_cam"], np.float64))
    except GrsError as error:
        return None, str(error)
    return make_picture(picture.color, f"The same view of the task, seed {instance.seed}, before the robot moves"), ""
