"""Figures of many scenes: rows, totals with their targets, CSV, Markdown and JSON."""

import csv
import io
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from evals.benchmark.segmentation_metrics import sum_scores
from evals.benchmark.types import ObjectFigures, SceneFigures
from grs_agents.base import Frozen
from grs_agents.files import write_json, write_text
from grs_agents.run.experiments import markdown

COLUMNS = ("scene", "sensor", "tilt", "objects", "segments", "IoU", "F1@.5", "F1@.75", "over", "under", "boundary F",
           "centre mm", "size mm", "position mm", "angle deg", "drift mm", "twin", "penetration mm",
           "frame deg", "frame mm", "CPU s", "MiB", "error")  # fmt: skip
"""Of the table of scenes. Lengths and angles are medians over its objects; ``twin`` is the share of the objects' pixels
at which the twin at rest is within 2 cm, ``penetration`` its deepest."""


SMALL, LARGE = 640 * 480, 1920 * 1080


class Target(Frozen):
    """A total and the bound it should keep, if any; its value is ``None`` where nothing was measured."""

    name: str
    value: float | None
    bound: float | None = None
    unit: str = ""
    smaller_is_better: bool = True

    @property
    def reached(self) -> bool | None:
        """Whether the bound is kept."""
        if self.value is None or self.bound is None:
            return None
        return self.value <= self.bound if self.smaller_is_better else self.value >= self.bound


def scene_row(scene: SceneFigures) -> dict[str, Any]:
    """The figures of one scene, one entry for each of `COLUMNS`; empty where there is nothing to say."""
    return {
        "scene": scene.name,
        "sensor": scene.sensor,
        "tilt": _text(scene.tilt, 0),
        **_shared([scene]),
        "CPU s": _text(scene.cpu_seconds, 2),
        "MiB": _text(scene.peak_mib, 0),
        "error": scene.error,
    }


def total_row(name: str, scenes: Sequence[SceneFigures]) -> dict[str, Any]:
    """The figures of several scenes together, each object counting alike; the slowest and the largest of them."""
    return {
        "scene": name,
        "sensor": "",
        "tilt": "",
        **_shared(scenes),
        "CPU s": _text(max(scene.cpu_seconds for scene in scenes), 2),
        "MiB": _text(max(scene.peak_mib for scene in scenes), 0),
        "error": sum(bool(scene.error) for scene in scenes) or "",
    }


def total_rows(scenes: Sequence[SceneFigures]) -> list[dict[str, Any]]:
    """All scenes together; the synthesised ones beside others, and those of each sensor where there are several."""
    sensors = sorted({scene.sensor for scene in scenes})
    made = [scene for scene in scenes if scene.sensor]
    groups = [(f"all {len(scenes)}", list(scenes))]
    if 0 < len(made) < len(scenes):
        groups.append(("synthesised", made))
    if len(sensors) > 1:
        groups += [(name or "real", [scene for scene in scenes if scene.sensor == name]) for name in sensors]
    return [total_row(name, group) for name, group in groups]


def perception_targets(scenes: Sequence[SceneFigures]) -> list[Target]:
    """The totals that have a bound, and what tells how they came about."""
    score = sum_scores([scene.score for scene in scenes])
    objects = [one for scene in scenes for one in scene.objects]
    frames = [scene.frame for scene in scenes if scene.frame is not None]
    twins = [scene.twin for scene in scenes if scene.twin is not None]
    turned = _values(objects, lambda one: None if one.symmetric else one.angle)
    return [
        Target(name="F1 at IoU 0.5", value=score.f1[0], bound=0.90, smaller_is_better=False),
        Target(name="mean IoU of matched", value=_finite(score.mean_iou), bound=0.85, smaller_is_better=False),
        Target(name="box centre, median", value=_median(_values(objects, lambda one: one.center), 1000), bound=10,
               unit="mm"),
        Target(name="box size, median", value=_median(_values(objects, lambda one: one.size), 1000), bound=15,
               unit="mm"),
        Target(name="asset position, median", value=_median(_values(objects, lambda one: one.position), 1000), bound=10,
               unit="mm"),
        Target(name="asset angle, median of those not round", value=_median(turned), bound=10, unit="deg"),
        Target(name="twin: pixels within 2 cm, mean", smaller_is_better=False, bound=0.9,
               value=_mean([one.fidelity for one in twins if one.fidelity is not None])),
        Target(name="twin: penetration, largest", value=max((1000 * one.penetration for one in twins), default=None),
               bound=1, unit="mm"),
        *_drifts(_values(objects, lambda one: one.drift)),
        Target(name="twin: objects held on something unseen", value=_mean(_values(objects, lambda one: one.held))),
        Target(name="assets within 1 cm and 10 deg", value=_mean(_values(objects, _stands))),
        Target(name="frame tilt, largest", value=max((one.tilt for one in frames), default=None), bound=1, unit="deg"),
        Target(name="frame height, largest", value=_largest_height([one.height for one in frames]), bound=5, unit="mm"),
        *_times("CPU up to 640x480", 1, [one for one in scenes if one.width * one.height <= SMALL]),
        *_times("CPU up to 1920x1080", 3, [one for one in scenes if SMALL < one.width * one.height <= LARGE]),
        Target(name="peak memory, largest", value=max((one.peak_mib for one in scenes), default=None), bound=1024,
               unit="MiB"),
    ]  # fmt: skip


def _times(name: str, bound: float, scenes: Sequence[SceneFigures]) -> list[Target]:
    """The least of each scene's tries, as a shared machine only ever adds to it: of the slowest scene, and the median;
    and the median of the medians of the tries."""
    least = [one.cpu_seconds for one in scenes]
    usual = _median([one.cpu_median or one.cpu_seconds for one in scenes])
    return [
        Target(name=f"{name}, largest", value=max(least, default=None), bound=bound, unit="s"),
        Target(name=f"{name}, median", value=_median(least), bound=bound, unit="s"),
        Target(name=f"{name}, median of the tries' medians", value=usual, bound=bound, unit="s"),
    ]


def _drifts(drifts: Sequence[float]) -> list[Target]:
    """How far objects drift until the twin rests: the median, what 95 % keep, the farthest, and how many keep 1 cm."""
    ordered = sorted(1000 * drift for drift in drifts)
    most = [ordered[max(0, math.ceil(share * len(ordered)) - 1)] for share in (0.95, 1.0)] if ordered else [None, None]
    near = _mean([float(drift <= 10) for drift in ordered])
    return [
        Target(name="twin: drift, median", value=_median(ordered), bound=10, unit="mm"),
        Target(name="twin: drift, 95 %", value=most[0], bound=10, unit="mm"),
        Target(name="twin: drift, largest", value=most[1], bound=10, unit="mm"),
        Target(name="twin: objects that drift by at most 1 cm", value=near, bound=1.0, smaller_is_better=False),
    ]


def _stands(one: ObjectFigures) -> bool | None:
    """Whether an asset stands where it should, as far as can be seen."""
    if one.position is None or one.angle is None:
        return None
    return one.position <= 0.01 and (one.angle <= 10 or bool(one.symmetric))


def write_figures(out: Path, scenes: Sequence[SceneFigures]) -> dict[str, Any]:
    """Write ``figures.json``, ``figures.md``, ``scenes.csv`` and ``objects.csv`` into ``out``.

    Returns:
        The content of ``figures.json``.
    """
    rows, sums, bounds = [scene_row(scene) for scene in scenes], total_rows(scenes), perception_targets(scenes)
    value = {
        "targets": [{**one.model_dump(), "reached": one.reached} for one in bounds],
        "totals": sums,
        "rows": rows,
        "scenes": [scene.model_dump(mode="json") for scene in scenes],
    }
    write_json(out / "figures.json", value)
    write_text(out / "scenes.csv", _csv(COLUMNS, [*rows, *sums]))
    write_text(out / "objects.csv", _csv(("scene", *ObjectFigures.model_fields), _object_rows(scenes)))
    write_text(out / "figures.md", "\n".join((_targets_table(bounds), markdown(COLUMNS, [*rows, *sums]))))
    return value


def _shared(scenes: Sequence[SceneFigures]) -> dict[str, str | int]:
    score = sum_scores([scene.score for scene in scenes])
    objects = [one for scene in scenes for one in scene.objects]
    frames = [scene.frame for scene in scenes if scene.frame is not None]
    twins = [scene.twin for scene in scenes if scene.twin is not None]
    return {
        "objects": score.objects,
        "segments": score.segments,
        "IoU": _text(_finite(score.mean_iou), 3),
        "F1@.5": _text(score.f1[0], 3),
        "F1@.75": _text(score.f1[1], 3),
        "over": _text(score.over_segmentation, 2),
        "under": _text(score.under_segmentation, 2),
        "boundary F": _text(score.boundary_f, 3),
        "centre mm": _text(_median(_values(objects, lambda one: one.center), 1000), 1),
        "size mm": _text(_median(_values(objects, lambda one: one.size), 1000), 1),
        "position mm": _text(_median(_values(objects, lambda one: one.position), 1000), 1),
        "angle deg": _text(_median(_values(objects, lambda one: one.angle)), 1),
        "drift mm": _text(_median(_values(objects, lambda one: one.drift), 1000), 1),
        "twin": _text(_mean([one.fidelity for one in twins if one.fidelity is not None]), 3),
        "penetration mm": _text(max((1000 * one.penetration for one in twins), default=None), 2),
        "frame deg": _text(max((one.tilt for one in frames), default=None), 2),
        "frame mm": _text(_largest_height([one.height for one in frames]), 1),
    }


def _object_rows(scenes: Sequence[SceneFigures]) -> list[dict[str, Any]]:
    return [
        {"scene": scene.name, **{key: _exact(value) for key, value in one.model_dump().items()}}
        for scene in scenes
        for one in scene.objects
    ]


def _targets_table(bounds: Sequence[Target]) -> str:
    lines = ["| figure | measured | target |", "|---|---|---|"]
    for one in bounds:
        if one.value is not None:
            sign, missed = (
                "at most" if one.smaller_is_better else "at least",
                " (missed)" if one.reached is False else "",
            )
            bound = "" if one.bound is None else f"{sign} {one.bound:g} {one.unit}"
            lines.append(f"| {one.name} | {one.value:.3g} {one.unit}{missed} | {bound} |")
    return "\n".join(lines) + "\n"


def _csv(columns: Sequence[str], rows: Iterable[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _values(objects: Sequence[ObjectFigures], value: Callable[[ObjectFigures], float | None]) -> list[float]:
    return [found for one in objects if (found := value(one)) is not None]


def _median(values: Sequence[float], times: float = 1.0) -> float | None:
    return times * statistics.median(values) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _largest_height(heights: Sequence[float]) -> float | None:
    return 1000 * max(abs(one) for one in heights) if heights else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _exact(value: object) -> object:
    return f"{value:.5g}" if isinstance(value, float) else value
