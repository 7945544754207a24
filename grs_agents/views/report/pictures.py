"""Pictures of a report: photo with boxes, photo over twin, the task from the photo's camera, and the rollouts of the
last audit with a film."""

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
from grs_agents.views.report import html

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


def render_film(drawn: Sequence[DrawnRollout], reason: str = "") -> str:
    """The filmed rollout; empty without a film. ``reason`` is that of a rejected run."""
    for item in drawn:
        if item.rate and item.images:
            film = encode_animation(item.images, item.rate, "webp")
            caption = f"The oracle at the task, seed {item.event.seed}: {reason or item.event.outcome}"
            return html.render_film(film, item.images[-1], caption)
    return ""


def render_rollouts(drawn: Sequence[DrawnRollout]) -> Iterator[str]:
    """Each rollout: its summary, the images before and after."""
    for item in drawn:
        yield html.render_paragraph(item.summary, "good" if item.event.outcome == "success" else "bad")
        if item.problem:
            yield html.render_paragraph(f"There is no picture of it: {item.problem}", "quiet")
        if item.images:
            stills = ((item.images[0], "before"), (item.images[-1], "after"))
            yield html.render_side_by_side(
                *(html.render_picture(image, f"{name}, seed {item.event.seed}") for image, name in stills)
            )


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


def render_photo_or_twin(photo: PhotoParts, folder: Path) -> str:
    """The photo over its twin; without a twin the photo alone."""
    return _render_photo_over_twin(photo.files, folder) or _render_annotated_photo(photo, folder)


def render_scene(events: Sequence[Event], photo: PhotoParts, sources: Sources) -> Iterator[str]:
    """The photo with numbered boxes around its objects, the task from the photo's camera, and a table of objects."""
    sources.report_drawing_progress("the camera's view of the simulation")
    boxed = _render_annotated_photo(photo, sources.folder)
    yield html.render_side_by_side(boxed, _render_task_view(events, sources, photo.camera))
    if photo.objects:
        bystanders = _find_bystander_labels(events, sources.folder)
        rows = [
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
        yield html.render_table(["", "name", "size (cm)", "asset", "description", "in the task"], rows, (0,))


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


def _render_annotated_photo(photo: PhotoParts, folder: Path) -> str:
    import cv2

    file = find_member_file(folder, photo.files["rgb"]) if "rgb" in photo.files else None
    if file is None:
        return ""
    image = read_picture(file, cv2.IMREAD_COLOR)
    drawn = find_member_file(folder, photo.files["masks"]) if "masks" in photo.files else None
    labels = read_picture(drawn, cv2.IMREAD_UNCHANGED) if drawn is not None else None
    numbers = {object_mask_label(item, index) for index, item in enumerate(photo.objects)}
    boxes = mask_bounding_boxes(labels) if labels is not None and labels.shape == image.shape[:2] else {}
    marks: list[tuple[str, Rectangle]] = [(str(label), box) for label, box in boxes.items() if label in numbers]
    return html.render_picture(
        np.asarray(image[:, :, ::-1], np.uint8), "The photo, with the objects found in it", marks
    )


def _render_photo_over_twin(files: dict[str, str], folder: Path) -> str:
    """The photo over its twin, up to a draggable edge; in print side by side."""
    import cv2

    paths = [find_member_file(folder, files[name]) if name in files else None for name in ("rgb", "twin")]
    if paths[0] is None or paths[1] is None:
        return ""
    photo, twin = (read_picture(file, cv2.IMREAD_COLOR)[:, :, ::-1] for file in paths if file is not None)
    height, width = twin.shape[:2]
    photo = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    over, under = (
        f'<img src="{html.picture_url(np.asarray(image, np.uint8))}" width="{width}" height="{height}" alt="{name}">'
        for image, name in ((photo, "The photo"), (twin, "Its twin"))
    )
    caption = "The photo (left) and its twin in MuJoCo: drag the corner of the photo"
    return (
        f'<figure><div class="compare">{under}<div class="over">{over}</div></div>'
        f"<figcaption>{html.escape_html(caption)}</figcaption></figure>"
    )


def _render_task_view(events: Sequence[Event], sources: Sources, camera: dict[str, Any]) -> str:
    """The task from the photo's camera; empty for a run without rollouts."""
    played = [event for event in last_audit_events(events, Rollout) if event.instance]
    if not played or not camera.get("T_robot_cam"):
        return ""
    try:
        instance = read_task_instance(resolve_member_file(sources.folder, played[0].instance or ""))
        lens = Lens(**{name: camera[name] for name in ("fx", "fy", "cx", "cy", "width", "height")})
        small = resize_lens(lens, round(_VIEW_WIDTH * lens.height / lens.width), _VIEW_WIDTH)
        props = replace(scene_props_from_instance(instance), arm=None)
        picture = render_from_camera(props, sources.library, small, np.asarray(camera["T_robot_cam"], np.float64))
    except GrsError as error:
        return html.render_paragraph(f"The simulation cannot be drawn: {error}", "quiet")
    return html.render_picture(
        picture.color, f"The same view of the task, seed {instance.seed}, before the robot moves"
    )
