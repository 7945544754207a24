"""The pictures of a report: the photo with its boxes, photo over twin, the task as the photo's camera sees it, and the
rollouts of the last audit, one of them as a film."""

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
from grs_agents.sim.rendering.lenses import resize_lens
from grs_agents.sim.rendering.stage import scene_props_from_instance
from grs_agents.sim.rendering.textured_pictures import render_from_camera
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
"""Pictures a second of the film, or fewer: it has at most so many in all."""
_MOST_PICTURES = 96
_FILM_SIZE = (560, 420)
"""Width and height of film and stills, pixels."""
_VIEW_WIDTH = 640
"""Pixels of the view of the task."""


@dataclass(frozen=True)
class Sources:
    """Where pictures come from."""

    folder: Path
    library: Library  # 3D assets, the run's own laid over
    show: Callable[[str], None] | None = None  # is told what is drawn next

    def report_drawing_progress(self, what: str) -> None:
        """Say what is drawn next."""
        if self.show is not None:
            self.show(f"drawing {what}")


@dataclass(frozen=True)
class DrawnRollout:
    """A rollout with its pictures: a film's, or the first and the last."""

    event: Rollout
    images: list[Image] = field(default_factory=list[Image])
    rate: float = 0.0  # pictures a second of a film; 0 if it is none
    problem: str = ""  # why there is no picture

    @property
    def summary(self) -> str:
        """How it went."""
        event = self.event
        cause = f" ({event.cause})" if event.cause else ""
        verdict = f"Seed {event.seed}: {event.outcome}{cause}, reward {event.reward:.2f} after {event.steps} steps; "
        return f"{verdict}doing nothing earns {event.idle_reward:.2f}; moved {', '.join(event.moved) or 'nothing'}"


@dataclass(frozen=True)
class _DrawingPlan:
    """What is to be drawn of a rollout."""

    take: Take
    rate: float = 0.0  # pictures a second of a film; 0 if it is none

    def finish(self, images: Iterator[Image]) -> DrawnRollout:
        """The rollout with its pictures; those of a film with captions."""
        shown = draw_take_captions(self.take, images) if self.rate else images
        return DrawnRollout(self.take[0].event, list(shown), self.rate)


def last_audit_events(events: Sequence[Event], kind: type[AuditEvent]) -> list[AuditEvent]:
    """Return the last audit's rollouts or findings, or the rollouts that the node ``conclude`` played."""
    nodes = ("audit", "conclude") if kind is Rollout else ("audit",)
    starts = [at for at, event in enumerate(events) if isinstance(event, NodeStarted) and event.node in nodes]
    for at in reversed(starts or [0]):
        judged = [event for event in events[at:] if isinstance(event, Rollout | Finding)]
        if judged:
            return [event for event in judged if isinstance(event, kind)]
    return []


def draw_last_audit_rollouts(events: Sequence[Event], sources: Sources) -> list[DrawnRollout]:
    """The rollouts of the last audit; the first that failed, or else the first, as a film."""
    played = last_audit_events(events, Rollout)
    failed = (event for event in played if event.cause or event.outcome != "success")
    filmed = next(failed, next(iter(played), None))
    planned = [_plan_rollout(event, sources, event is filmed) for event in played]
    sources.report_drawing_progress(f"{len(played)} rollouts")
    drawn = iter(_draw_planned_rollouts([plan for plan in planned if not isinstance(plan, DrawnRollout)]))
    return [plan if isinstance(plan, DrawnRollout) else next(drawn) for plan in planned]


def _plan_rollout(event: Rollout, sources: Sources, filmed: bool) -> _DrawingPlan | DrawnRollout:
    """What is to be drawn of a rollout; what came of it where nothing can be."""
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
    """The rollouts, drawn by one process; where it fails, each by its own."""
    try:
        images = render_takes([plan.take for plan in plans]) if plans else iter(())
        return [plan.finish(islice(images, len(plan.take[1]))) for plan in plans]
    except GrsError as error:
        if len(plans) == 1:
            return [DrawnRollout(plans[0].take[0].event, problem=str(error))]
        return [drawn for plan in plans for drawn in _draw_planned_rollouts([plan])]


def render_film(drawn: Sequence[DrawnRollout], reason: str = "") -> str:
    """The rollout that is a film; nothing where there is none. ``reason`` is that of a rejected run."""
    for one in drawn:
        if one.rate and one.images:
            film = encode_animation(one.images, one.rate, "webp")
            caption = f"The oracle at the task, seed {one.event.seed}: {reason or one.event.outcome}"
            return html.render_film(film, one.images[-1], caption)
    return ""


def render_rollouts(drawn: Sequence[DrawnRollout]) -> Iterator[str]:
    """Each rollout: its figures, before and after."""
    for one in drawn:
        yield html.render_paragraph(one.summary, "good" if one.event.outcome == "success" else "bad")
        if one.problem:
            yield html.render_paragraph(f"There is no picture of it: {one.problem}", "quiet")
        if one.images:
            stills = ((one.images[0], "before"), (one.images[-1], "after"))
            yield html.render_side_by_side(
                *(html.render_picture(image, f"{name}, seed {one.event.seed}") for image, name in stills)
            )


@dataclass
class PhotoParts:
    """What the stages of comprehension left of the photo."""

    files: dict[str, str] = field(default_factory=dict[str, str])
    camera: dict[str, Any] = field(default_factory=dict[str, Any])
    objects: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])


def merge_scene_stage_summaries(events: Sequence[Event]) -> PhotoParts:
    """What later stages say replaces what earlier ones said."""
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
    """The photo with a numbered box around each object, the task as the photo's camera would see it, and the objects
    as a table."""
    sources.report_drawing_progress("the camera's view of the simulation")
    boxed = _render_annotated_photo(photo, sources.folder)
    yield html.render_side_by_side(boxed, _render_task_view(events, sources, photo.camera))
    if photo.objects:
        others = _find_bystander_labels(events, sources.folder)
        rows = [(*_object_row_cells(at, item), others.get(at, "")) for at, item in enumerate(photo.objects)]
        yield html.render_table(["", "name", "size (cm)", "asset", "description", "in the task"], rows, (0,))


def _object_row_cells(index: int, item: dict[str, Any]) -> tuple[object, ...]:
    asset, description = item.get("asset") or "", item.get("description") or ""
    return object_mask_label(item, index), object_display_name(item), format_object_size(item), asset, description


def _find_bystander_labels(events: Sequence[Event], folder: Path) -> dict[int, str]:
    """What the objects of the scene are, by their place in its list, that no goal of the last audit's task is about."""
    played = [event.instance for event in last_audit_events(events, Rollout) if event.instance]
    try:
        objects = read_task_instance(resolve_member_file(folder, played[0])).objects if played else ()
    except GrsError:  # the picture of the task says so
        return {}
    others = (item for item in objects if item.role == "bystander")
    return {
        item.id - FIRST_BYSTANDER: "fixed bystander" if item.category == "fixed" else "bystander" for item in others
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
    """The photo over its twin, up to an edge that can be dragged; in print one beside the other."""
    import cv2

    found = [find_member_file(folder, files[name]) if name in files else None for name in ("rgb", "twin")]
    if found[0] is None or found[1] is None:
        return ""
    photo, twin = (read_picture(file, cv2.IMREAD_COLOR)[:, :, ::-1] for file in found if file is not None)
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
    """The task as the camera of the photo would see it; nothing of a run that came to none."""
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
