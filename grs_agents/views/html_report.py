"""A run as one HTML page to send to somebody who has none of this installed.
The page needs nothing from anywhere, and all text from outside is escaped. Its pictures: the photo with its boxes, its
twin, and the rollouts from beginning to end."""

import base64
import html
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import numpy as np
import numpy.typing as npt

from grs_agents import trace
from grs_agents.errors import GrsError
from grs_agents.foreign import find_member_file, read_bytes, read_picture, resolve_member_file
from grs_agents.library import Lens, Library
from grs_agents.sim.rendering import render_from_camera, resize_lens, scene_props_from_instance
from grs_agents.sim.world import FIRST_BYSTANDER
from grs_agents.terminal import escape_control_chars
from grs_agents.views.common import (
    Rectangle,
    Step,
    format_finding_verdict,
    format_object_size,
    group_events_into_steps,
    iter_step_sections,
    mask_bounding_boxes,
    object_display_name,
    object_mask_label,
    read_task_instance,
)
from grs_agents.views.film import Shot, render_frames

AuditEvent = TypeVar("AuditEvent", trace.Rollout, trace.Finding)
Verdict = Literal["", "good", "bad"]
"""The class, and so the colour, of what went well or wrong."""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_STYLE = """
:root{color-scheme:light dark;--line:#8884;--good:#1a7f37;--bad:#cf222e;--soft:#8881}
body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}
h1{margin:0 0 .2rem}h2{margin:2.4rem 0 .6rem;border-bottom:1px solid var(--line)}
table{border-collapse:collapse;width:100%}td,th{padding:.25rem .6rem;border-bottom:1px solid var(--line);
text-align:left;vertical-align:top;overflow-wrap:break-word}td.n,th.n{text-align:right;white-space:nowrap}
pre{background:var(--soft);padding:.8rem;overflow:auto;font:13px/1.45 ui-monospace,monospace;border-radius:6px}
figure{margin:0}figcaption{font-size:.9rem;opacity:.8}img,svg{max-width:100%;height:auto;display:block;border-radius:6px}
.row{display:flex;flex-wrap:wrap;gap:1rem}.row>*{flex:1 1 20rem}.strip{display:flex;gap:4px}
.strip>*{flex:1 1 0;min-width:0}
.good{color:var(--good)}.bad{color:var(--bad)}.add{color:var(--good)}.del{color:var(--bad)}.hunk{opacity:.6}
.table{overflow-x:auto}
.compare{position:relative;container-type:inline-size;line-height:0}.compare img{width:100%}
.over{position:absolute;inset:0 auto 0 0;width:50%;min-width:1.2rem;max-width:100%;overflow:hidden;resize:horizontal;
border-right:3px solid #fff;box-shadow:2px 0 4px #0008}.over img{width:100cqw;max-width:none;height:100%}
.over::-webkit-resizer{background:#fff}
@media print{figure:has(.compare){flex-basis:100%}
.compare{display:flex;gap:1rem;container-type:normal}.compare>*{flex:1 1 0;min-width:0}
.over{position:static;width:auto!important;border:0;box-shadow:none;order:-1}.over img{width:100%;height:auto}}
.status{font-size:1.2rem;font-weight:600}.quiet{opacity:.75}summary{cursor:pointer}
"""


def escape_html(value: object) -> str:
    """``value`` as text of a page: escaped, control characters spelt out."""
    return html.escape(escape_control_chars(str(value)), quote=True)


def render_page(title: str, body: Iterable[str]) -> str:
    """A whole page. Its policy lets no browser run or fetch anything, even if something got through."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="viewport" content="width=device-width"><title>{escape_html(title)}</title>\n'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def render_section(heading: str, *parts: str) -> str:
    """A heading and what stands below it; nothing without parts."""
    inner = "\n".join(part for part in parts if part)
    return f"<section><h2>{escape_html(heading)}</h2>\n{inner}</section>" if inner else ""


def render_paragraph(value: object, kind: str = "") -> str:
    """A paragraph of text."""
    return f"<p{_class_attribute(kind)}>{escape_html(value)}</p>"


def render_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    numbers: Sequence[int] = (),
    verdicts: Sequence[Verdict] = (),
) -> str:
    """A table of text; the columns ``numbers`` are set right, ``verdicts`` are the colours of the rows, if any."""

    def cells(tag: str, values: Sequence[object]) -> str:
        kinds = [' class="n"' if index in numbers else "" for index in range(len(values))]
        return "".join(f"<{tag}{kind}>{escape_html(value)}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    colors: Iterable[Verdict] = verdicts or repeat("")
    pairs = zip(rows, colors, strict=False)
    lines = "".join(f"<tr{_class_attribute(color)}>{cells('td', row)}</tr>\n" for row, color in pairs)
    return f'<div class="table"><table><tr>{cells("th", heads)}</tr>\n{lines}</table></div>'


def _class_attribute(name: str) -> str:
    return f' class="{name}"' if name else ""


def render_collapsible(summary: str, inner: str, opened: bool = False, verdict: Verdict = "") -> str:
    """Something to open by a click."""
    head = f"<summary{_class_attribute(verdict)}>{escape_html(summary)}</summary>"
    return f"<details{' open' if opened else ''}>{head}\n{inner}</details>"


def render_code_block(value: str) -> str:
    """A block of code."""
    return f"<pre>{escape_html(value)}</pre>"


def render_diff(value: str) -> str:
    """A unified diff in colours."""
    kinds = {"+": "add", "-": "del", "@": "hunk"}
    lines = (f'<span class="{kinds.get(line[:1], "")}">{escape_html(line)}</span>' for line in value.split("\n"))
    return "<pre>" + "\n".join(lines) + "</pre>"


def render_picture(image: npt.NDArray[np.uint8], caption: str = "", marks: Sequence[tuple[str, Rectangle]] = ()) -> str:
    """An image (H, W, 3) as a JPEG inside the page, with named boxes (pixels) drawn over it."""
    height, width = image.shape[:2]
    source = _data_url(image)
    if marks:
        boxes = "".join(_render_labelled_box(name, box, width / 640) for name, box in marks)
        below = f'<image href="{source}" width="{width}" height="{height}"/>'
        drawn = f'<svg viewBox="0 0 {width} {height}">{below}{boxes}</svg>'
    else:
        drawn = f'<img src="{source}" width="{width}" height="{height}" alt="{escape_html(caption)}">'
    return f"<figure>{drawn}<figcaption>{escape_html(caption)}</figcaption></figure>"


def _data_url(image: npt.NDArray[np.uint8]) -> str:
    """An image (H, W, 3) as a JPEG that stands in the page itself."""
    return f"data:image/jpeg;base64,{base64.b64encode(_encode_jpeg(image)).decode()}"


def _render_labelled_box(name: str, box: Rectangle, scale: float) -> str:
    left, top, width, height = box
    look = f'fill="none" stroke="#ffcd3c" stroke-width="{2 * scale:.1f}"'
    outline = f'stroke="#000" stroke-width="{3 * scale:.1f}" paint-order="stroke" fill="#ffcd3c"'
    rectangle = f'<rect x="{left}" y="{top}" width="{width}" height="{height}" {look}/>'
    place = f'x="{left}" y="{top - 3 * scale:.1f}" font-size="{15 * scale:.1f}"'
    return f"{rectangle}<text {place} {outline}>{escape_html(name)}</text>"


def _encode_jpeg(image: npt.NDArray[np.uint8]) -> bytes:
    import cv2

    return cv2.imencode(".jpg", np.ascontiguousarray(image[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


FRAMES = 6
"""Pictures of a film strip."""
VIEW_WIDTH = 640
"""Pixels of the view of the task."""


@dataclass(frozen=True)
class Sources:
    """Where pictures come from."""

    folder: Path
    library: Library  # 3D assets, the run's own laid over
    show: Callable[[str], None] | None = None  # is told what is drawn next

    def announce_drawing(self, what: str) -> None:
        """Say what is drawn next."""
        if self.show is not None:
            self.show(f"drawing {what}")


def render_photo_and_objects(events: Sequence[trace.Event], sources: Sources) -> Iterator[str]:
    """The photo with a numbered box around each object, photo and twin to compare, the task as the photo's camera would
    see it, and the objects as a table."""
    files: dict[str, str] = {}
    camera: dict[str, Any] = {}
    objects: list[dict[str, Any]] = []
    for event in events:
        if isinstance(event, trace.SceneStage):
            files.update(event.files)
            camera.update(event.summary.get("camera") or {})
            objects = event.summary.get("objects") or objects
    sources.announce_drawing("the camera's view of the simulation")
    shown = [
        _render_annotated_photo(files, objects, sources.folder),
        _render_photo_beside_twin(files, sources.folder),
        _render_task_view(events, sources, camera),
    ]
    if any(shown):
        yield f'<div class="row">{"".join(shown)}</div>'
    if objects:
        bystanders = _find_bystanders(events, sources.folder)
        rows = [(*_object_row_cells(at, item), bystanders.get(at, "")) for at, item in enumerate(objects)]
        yield render_table(["", "name", "size (cm)", "asset", "description", "in the task"], rows, (0,))


def _object_row_cells(index: int, item: dict[str, Any]) -> tuple[object, ...]:
    asset, description = item.get("asset") or "", item.get("description") or ""
    return object_mask_label(item, index), object_display_name(item), format_object_size(item), asset, description


def _find_bystanders(events: Sequence[trace.Event], folder: Path) -> dict[int, str]:
    """What the objects of the scene are, by their place in its list, that no goal of the last audit's task is about."""
    played = [event.instance for event in last_audit_events(events, trace.Rollout) if event.instance]
    try:
        objects = read_task_instance(resolve_member_file(folder, played[0])).objects if played else ()
    except GrsError:  # the picture of the task says so
        return {}
    others = (item for item in objects if item.role == "bystander")
    return {
        item.id - FIRST_BYSTANDER: "fixed bystander" if item.category == "fixed" else "bystander" for item in others
    }


def _render_annotated_photo(files: dict[str, str], objects: Sequence[dict[str, Any]], folder: Path) -> str:
    import cv2

    file = find_member_file(folder, files["rgb"]) if "rgb" in files else None
    if file is None:
        return ""
    image = read_picture(file, cv2.IMREAD_COLOR)
    drawn = find_member_file(folder, files["masks"]) if "masks" in files else None
    labels = read_picture(drawn, cv2.IMREAD_UNCHANGED) if drawn is not None else None
    numbers = {object_mask_label(item, index) for index, item in enumerate(objects)}
    boxes = mask_bounding_boxes(labels) if labels is not None and labels.shape == image.shape[:2] else {}
    marks: list[tuple[str, Rectangle]] = [(str(label), box) for label, box in boxes.items() if label in numbers]
    return render_picture(np.asarray(image[:, :, ::-1], np.uint8), "The photo, with the objects found in it", marks)


def _render_photo_beside_twin(files: dict[str, str], folder: Path) -> str:
    """The photo over its twin, up to an edge that can be dragged; in print one beside the other."""
    import cv2

    found = [find_member_file(folder, files[name]) if name in files else None for name in ("rgb", "twin")]
    if found[0] is None or found[1] is None:
        return ""
    photo, twin = (read_picture(file, cv2.IMREAD_COLOR)[:, :, ::-1] for file in found if file is not None)
    height, width = twin.shape[:2]
    photo = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    over, under = (
        f'<img src="{_data_url(np.asarray(image, np.uint8))}" width="{width}" height="{height}" alt="{name}">'
        for image, name in ((photo, "The photo"), (twin, "Its twin"))
    )
    caption = "The photo (left) and its twin in MuJoCo: drag the corner of the photo"
    return (
        f'<figure><div class="compare">{under}<div class="over">{over}</div></div>'
        f"<figcaption>{escape_html(caption)}</figcaption></figure>"
    )


def _render_task_view(events: Sequence[trace.Event], sources: Sources, camera: dict[str, Any]) -> str:
    """The task as the camera of the photo would see it; nothing of a run that came to none."""
    played = [event for event in last_audit_events(events, trace.Rollout) if event.instance]
    if not played or not camera.get("T_robot_cam"):
        return ""
    try:
        instance = read_task_instance(resolve_member_file(sources.folder, played[0].instance or ""))
        lens = Lens(**{name: camera[name] for name in ("fx", "fy", "cx", "cy", "width", "height")})
        small = resize_lens(lens, round(VIEW_WIDTH * lens.height / lens.width), VIEW_WIDTH)
        props = replace(scene_props_from_instance(instance), arm=None)
        picture = render_from_camera(props, sources.library, small, np.asarray(camera["T_robot_cam"], np.float64))
    except GrsError as error:
        return render_paragraph(f"The simulation cannot be drawn: {error}", "quiet")
    return render_picture(picture.color, f"The same view of the task, seed {instance.seed}, before the robot moves")


def last_audit_events(events: Sequence[trace.Event], kind: type[AuditEvent]) -> list[AuditEvent]:
    """The rollouts, or the findings, of the last audit."""
    starts = [at for at, event in enumerate(events) if isinstance(event, trace.NodeStarted) and event.node == "audit"]
    return [event for event in events[starts[-1] if starts else 0 :] if isinstance(event, kind)]


def render_rollouts(events: Sequence[trace.Event], sources: Sources) -> Iterator[str]:
    """Each rollout of the last audit: before, after and its figures; of the first one a film strip."""
    played = last_audit_events(events, trace.Rollout)
    for event in played:
        verdict = f"Seed {event.seed}: {event.outcome}, reward {event.reward:.2f} after {event.steps} steps; "
        text = f"{verdict}doing nothing earns {event.idle_reward:.2f}; moved {', '.join(event.moved) or 'nothing'}"
        yield render_paragraph(text, "" if event.outcome == "success" else "bad")
        drawn = event.instance and event.recording and find_member_file(sources.folder, event.recording)
        yield from _render_rollout_stills(event, sources, strip=event is played[0]) if drawn else ()


def _render_rollout_stills(event: trace.Rollout, sources: Sources, strip: bool) -> Iterator[str]:
    sources.announce_drawing(f"the rollout of seed {event.seed}")
    shot = Shot(sources.folder.resolve(), event, sources.library)
    try:
        end = shot.recorded_motion.duration_seconds
        moments = [0.0, end, *(np.linspace(0, end, FRAMES).tolist() if strip else ())]
        drawn = list(render_frames(shot, moments))
    except GrsError as error:
        yield render_paragraph(f"There is no picture of it: {error}", "quiet")
        return
    yield f'<div class="row">{render_picture(drawn[0], "before")}{render_picture(drawn[1], f"after {end:.1f} s")}</div>'
    small = [image[::2, ::2] for image in drawn[2:]]
    if small:
        frames = (render_picture(image, f"{seconds:.1f} s") for image, seconds in zip(small, moments[2:], strict=True))
        yield f'<div class="strip">{"".join(frames)}</div>'


def render_html_report(record: dict[str, Any], events: Sequence[trace.Event], sources: Sources) -> str:
    """The page."""
    rows = group_events_into_steps(list(events))
    parts = [
        _render_header(record, events),
        render_section("The photo", *render_photo_and_objects(events, sources)),
        render_section("The task", *_render_task_fields(events)),
        render_section("The oracle plays it", *render_rollouts(events, sources)),
        render_section("How it came about", _render_step_table(rows)),
        render_section("Decisions", *_render_decisions(events)),
        render_section("Tests", *_render_test_runs(rows)),
        render_section("Audit", _render_audit_findings(events)),
        render_section("Programs", *_render_programs(events, sources.folder)),
        render_paragraph(f"Made by grs-agents {record.get('versions', {}).get('grs-agents', '')}.", "quiet"),
    ]
    return render_page(f"GRS run {record.get('id', '')}", [part for part in parts if part])


def _render_header(record: dict[str, Any], events: Sequence[trace.Event]) -> str:
    status = str(record.get("status", "?"))
    started = next((event for event in events if isinstance(event, trace.RunStarted)), None)
    kind = "good" if status == "accepted" else "bad"
    how = f"graph {started.graph}, seed {started.seed}" if started else ""
    counts: dict[str, Any] = record.get("counts") or {}
    seconds: dict[str, Any] = record.get("seconds") or {}
    counted = {**counts, "seconds": seconds.get("total", "?")}
    figures = render_table(["what", "how much"], [(key.replace("_", " "), value) for key, value in counted.items()])
    title = f"<header><h1>{escape_html(record.get('id', 'run'))}</h1>\n"
    ended = f'<p><span class="status {kind}">{escape_html(status)}</span> {escape_html(record.get("reason", ""))}</p>'
    return title + ended + render_paragraph(how, "quiet") + render_collapsible("Figures", figures) + "</header>"


def _render_task_fields(events: Sequence[trace.Event]) -> Iterator[str]:
    tasks = [event.task for event in events if isinstance(event, trace.TaskDefined)]
    for key, value in (tasks[-1] if tasks else {}).items():
        shown = ", ".join(map(str, cast("list[Any]", value))) if isinstance(value, list) else value
        yield f"<p><b>{escape_html(key)}</b>: {escape_html(shown)}</p>"


def _render_step_table(rows: Sequence[Step]) -> str:
    heads = ["#", "fix", "step", "status", "seconds", "tokens", "what came of it"]
    colors: list[Verdict] = [_verdict_css_class(not step.problem_summary) for step in rows]
    return render_table(heads, map(_step_row_cells, rows), (0, 1, 4, 5), colors) if rows else ""


def _step_row_cells(step: Step) -> tuple[object, ...]:
    name = f"{step.node} ×{step.visit}" if step.visit > 1 else step.node
    tokens = f"{step.total_tokens:,}" if step.total_tokens else ""
    status = "found faults" if step.status == "done" and step.problem_summary else step.status
    return (step.number, step.attempt, name, status, f"{step.seconds:.1f}", tokens, step.joined_details[:1000])


def _verdict_css_class(well: bool) -> Verdict:
    return "" if well else "bad"


def _render_decisions(events: Sequence[trace.Event]) -> Iterator[str]:
    for event in events:
        if isinstance(event, trace.Decision):
            policy = f" by {event.policy}" if event.policy else ""
            yield f"<p><b>{escape_html(event.verdict)}</b>{escape_html(policy)}: {escape_html(event.explanation)}</p>"


def _render_test_runs(rows: Sequence[Step]) -> Iterator[str]:
    """Each run of the tests in full; the last one is open if it failed."""
    runs = [step for step in rows if any(isinstance(event, trace.TestsRun) for event in step.events)]
    for step in runs:
        text_of_step = "\n\n".join(f"{part.heading}\n{part.text}" for part in iter_step_sections(step))
        heading, trouble = f"step {step.number}: {step.joined_details}", bool(step.problem_summary)
        opened = trouble and step is runs[-1]
        yield render_collapsible(heading, render_code_block(text_of_step), opened, _verdict_css_class(not trouble))


def _render_audit_findings(events: Sequence[trace.Event]) -> str:
    """What the last audit found."""
    findings = last_audit_events(events, trace.Finding)
    cells = [(one.check, format_finding_verdict(one), one.measured, one.bound) for one in findings]
    colors: list[Verdict] = [_verdict_css_class(finding.passed) for finding in findings]
    return render_table(["check", "", "measured", "asked"], cells, verdicts=colors) if cells else ""


def _render_programs(events: Sequence[trace.Event], folder: Path) -> Iterator[str]:
    """Each version as what it changed, then both programs as they ended."""
    last: dict[str, trace.ProgramVersion] = {}
    for event in events:
        if isinstance(event, trace.ProgramVersion):
            last[event.program] = event
            if event.parent is not None and event.diff:
                heading = f"{event.program} version {event.number} by {event.author_role}"
                yield render_collapsible(heading, render_diff(event.diff), True)
    for program, event in last.items():
        file = find_member_file(folder, event.path)
        if file is not None:
            source = read_bytes(file).decode("utf-8", "replace")
            yield render_collapsible(f"{program}, version {event.number}, whole", render_code_block(source))
