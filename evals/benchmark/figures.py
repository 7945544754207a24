"""Figures of many scenes: rows, totals with their targets, CSV, Markdown and JSON."""

import csv
import io
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from evals.benchmark.segmentation_metrics import sum_scores
from evals.benchmark.types import ObjectFigures, SceneFigures
from grs_agents.files import write_json, write_text
from grs_agents.metrics import Figure, metrics_to_dicts
from grs_agents.runs import markdown_table

_LENGTHS = {"centre mm": "center", "size mm": "size", "position mm": "position", "drift mm": "drift"}
_DIGITS = {
    "IoU": 3,
    "F1@.5": 3,
    "F1@.75": 3,
    "over": 2,
    "under": 2,
    "boundary F": 3,
    "centre mm": 1,
    "size mm": 1,
    "position mm": 1,
    "angle deg": 1,
    "drift mm": 1,
    "twin": 3,
    "penetration mm": 2,
    "frame deg": 2,
    "frame mm": 1,
}
COLUMNS = ("scene", "sensor", "tilt", "objects", "segments", *_DIGITS, "CPU s", "MiB", "error")
"""Of the table of scenes. Lengths and angles are medians over its objects; ``twin`` is the share of the objects' pixels
at which the twin at rest is within 2 cm, ``penetration`` its deepest."""
SMALL, LARGE = 640 * 480, 1920 * 1080


def scene_row(scene: SceneFigures) -> dict[str, Any]:
    """The figures of one scene, one entry for each of `COLUMNS`; empty where there is nothing to say."""
    tilt = _text(scene.tilt, 0)
    return {**_row(scene.name, [scene]), "sensor": scene.sensor, "tilt": tilt, "error": scene.error}


def _row(name: str, scenes: Sequence[SceneFigures]) -> dict[str, Any]:
    """The figures of several scenes together, each object counting alike; the slowest and the largest of them."""
    summary = _summary(scenes)
    return {
        "scene": name,
        "sensor": "",
        "tilt": "",
        "objects": sum(scene.score.objects for scene in scenes),
        "segments": sum(scene.score.segments for scene in scenes),
        **{column: _text(summary[column], digits) for column, digits in _DIGITS.items()},
        "CPU s": _text(max(scene.cpu_seconds for scene in scenes), 2),
        "MiB": _text(max(scene.peak_mib for scene in scenes), 0),
        "error": sum(bool(scene.error) for scene in scenes) or "",
    }


def total_rows(scenes: Sequence[SceneFigures]) -> list[dict[str, Any]]:
    """All scenes together; the synthesised ones beside others, and those of each sensor where there are several."""
    by_sensor: dict[str, list[SceneFigures]] = {}
    for scene in sorted(scenes, key=lambda scene: scene.sensor):
        by_sensor.setdefault(scene.sensor, []).append(scene)
    groups = [(f"all {len(scenes)}", list(scenes))]
    if len(by_sensor) > 1:
        if "" in by_sensor:
            groups.append(("synthesised", [scene for scene in scenes if scene.sensor]))
        groups += [(name or "real", group) for name, group in by_sensor.items()]
    return [_row(name, group) for name, group in groups]


def _summary(scenes: Sequence[SceneFigures]) -> dict[str, float | None]:
    """The totals of scenes by column; ``None`` where nothing was measured."""
    score = sum_scores([scene.score for scene in scenes])
    objects = [one for scene in scenes for one in scene.objects]
    frames = [scene.frame for scene in scenes]
    twins = [scene.twin for scene in scenes]
    return {
        "IoU": score.mean_iou if math.isfinite(score.mean_iou) else None,
        "F1@.5": score.f1[0],
        "F1@.75": score.f1[1],
        "over": score.over_segmentation,
        "under": score.under_segmentation,
        "boundary F": score.boundary_f,
        **{column: _median(_known(objects, name), 1000) for column, name in _LENGTHS.items()},
        "angle deg": _median(_known(objects, "angle")),
        "twin": _mean(_known(twins, "fidelity")),
        "penetration mm": max((1000 * value for value in _known(twins, "penetration")), default=None),
        "frame deg": max(_known(frames, "tilt"), default=None),
        "frame mm": max((1000 * abs(value) for value in _known(frames, "height")), default=None),
    }


def perception_targets(scenes: Sequence[SceneFigures]) -> list[Figure]:
    """The totals that have a bound, and what tells how they came about."""
    objects = [one for scene in scenes for one in scene.objects]
    sums, not_round = _summary(scenes), [one for one in objects if not one.symmetric]
    return [
        _at_least("F1 at IoU 0.5", sums["F1@.5"], 0.90),
        _at_least("mean IoU of matched", sums["IoU"], 0.85),
        _at_most("box centre, median", sums["centre mm"], 10, "mm"),
        _at_most("box size, median", sums["size mm"], 15, "mm"),
        _at_most("asset position, median", sums["position mm"], 10, "mm"),
        _at_most("asset angle, median of those not round", _median(_known(not_round, "angle")), 10, "deg"),
        _at_least("twin: pixels within 2 cm, mean", sums["twin"], 0.9),
        _at_most("twin: penetration, largest", sums["penetration mm"], 1, "mm"),
        *_drifts(sorted(1000 * drift for drift in _known(objects, "drift"))),
        _at_most("twin: objects held on something unseen", _mean(_known(objects, "held"))),
        _at_most(
            "assets within 1 cm and 10 deg", _mean([near for one in objects if (near := _stands(one)) is not None])
        ),
        _at_most("frame tilt, largest", sums["frame deg"], 1, "deg"),
        _at_most("frame height, largest", sums["frame mm"], 5, "mm"),
        *_times("CPU up to 640x480", 1, [one for one in scenes if one.width * one.height <= SMALL]),
        *_times("CPU up to 1920x1080", 3, [one for one in scenes if SMALL < one.width * one.height <= LARGE]),
        _at_most("peak memory, largest", max(_known(scenes, "peak_mib"), default=None), 1024, "MiB"),
    ]


def _at_most(name: str, value: float | None, target: float | None = None, unit: str = "") -> Figure:
    return Figure(name=name, value=value, target=target, unit=unit)


def _at_least(name: str, value: float | None, target: float) -> Figure:
    return Figure(name=name, value=value, target=target, smaller_is_better=False)


def _times(name: str, target: float, scenes: Sequence[SceneFigures]) -> list[Figure]:
    """The least of each scene's tries, as a shared machine only ever adds to it: of the slowest scene, and the median;
    and the median of the medians of the tries."""
    least = [one.cpu_seconds for one in scenes]
    medians = [one.cpu_median or one.cpu_seconds for one in scenes]
    return [
        _at_most(f"{name}, largest", max(least, default=None), target, "s"),
        _at_most(f"{name}, median", _median(least), target, "s"),
        _at_most(f"{name}, median of the tries' medians", _median(medians), target, "s"),
    ]


def _drifts(drifts: Sequence[float]) -> list[Figure]:
    """How far objects drift (mm, sorted) until the twin rests: median, 95 %, largest, share that keeps 1 cm."""
    most = drifts[max(0, math.ceil(0.95 * len(drifts)) - 1)] if drifts else None
    near = _mean([float(drift <= 10) for drift in drifts])
    return [
        _at_most("twin: drift, median", _median(drifts), 10, "mm"),
        _at_most("twin: drift, 95 %", most, 10, "mm"),
        _at_most("twin: drift, largest", max(drifts, default=None), 10, "mm"),
        _at_least("twin: objects that drift by at most 1 cm", near, 1.0),
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
    rows, sums, figures = [scene_row(scene) for scene in scenes], total_rows(scenes), perception_targets(scenes)
    value = {
        "targets": metrics_to_dicts(figures),
        "totals": sums,
        "rows": rows,
        "scenes": [scene.model_dump(mode="json") for scene in scenes],
    }
    objects = [
        {"scene": scene.name, **{key: _exact(value) for key, value in one.model_dump().items()}}
        for scene in scenes
        for one in scene.objects
    ]
    write_json(out / "figures.json", value)
    write_text(out / "scenes.csv", csv_text(COLUMNS, [*rows, *sums]))
    write_text(out / "objects.csv", csv_text(("scene", *ObjectFigures.model_fields), objects))
    write_text(out / "figures.md", "\n".join((_targets_table(figures), markdown_table(COLUMNS, [*rows, *sums]))))
    return value


def _targets_table(figures: Sequence[Figure]) -> str:
    rows = [
        {
            "figure": figure.name,
            "measured": f"{figure.value:.3g} {figure.unit}{' (missed)' if figure.is_target_met is False else ''}",
            "target": figure.format_target_value().replace("<=", "at most").replace(">=", "at least"),
        }
        for figure in figures
        if figure.value is not None
    ]
    return markdown_table(("figure", "measured", "target"), rows)


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """The rows as CSV with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _known(things: Sequence[object], name: str) -> list[float]:
    """An attribute of those that have it."""
    return [value for thing in things if (value := getattr(thing, name, None)) is not None]


def _median(values: Sequence[float], times: float = 1.0) -> float | None:
    return times * statistics.median(values) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _exact(value: object) -> object:
    return f"{value:.5g}" if isinstance(value, float) else value
