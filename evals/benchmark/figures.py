"""Figures of many scenes: rows, totals with their targets, CSV, Markdown and JSON."""

import csv
import io
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from evals.benchmark.segmentation_metrics import sum_scores
from evals.benchmark.types import ObjectFigures, RunFigures, SceneFigures
from grs_agents.base.control_characters import escape_formula
from grs_agents.base.files import write_json, write_text
from grs_agents.runs.experiments import markdown_table
from grs_agents.runs.metrics import Figure, metrics_to_dicts

_LENGTHS = {"centre mm": "center", "size mm": "size", "depth mm": "depth_error", "position mm": "position"}
_DIGITS = {
    "IoU": 3,
    "F1@.5": 3,
    "F1@.75": 3,
    "over": 2,
    "under": 2,
    "centre mm": 1,
    "size mm": 1,
    "silhouette": 3,
    "depth mm": 1,
    "position mm": 1,
    "angle deg": 1,
    "coverage": 3,
    "true coverage": 3,
    "twin": 3,
    "penetration mm": 2,
    "frame deg": 2,
    "frame mm": 1,
}
COLUMNS = ("scene", "sensor", "tilt", "objects", "segments", *_DIGITS, "CPU s", "MiB", "error")
"""Columns of the table of scenes. Lengths, angles and silhouettes are medians over its objects; ``twin`` is the share
of the objects' pixels at which the twin at rest is within 2 cm, ``penetration`` its deepest."""
SMALL, LARGE = 640 * 480, 1920 * 1080


def scene_row(scene: SceneFigures) -> dict[str, Any]:
    """The figures of a scene, an entry for each of `COLUMNS`; empty entries without a value."""
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
    """Totals of all scenes, of synthesised and other scenes, and of each sensor if there are several."""
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
    """The totals of scenes by column; ``None`` if nothing was measured."""
    score = sum_scores([scene.score for scene in scenes])
    objects = [item for scene in scenes for item in scene.objects]
    frames = [scene.frame for scene in scenes]
    twins, runs = [scene.twin for scene in scenes], _runs(scenes)
    return {
        "IoU": score.mean_iou if math.isfinite(score.mean_iou) else None,
        "F1@.5": score.f1[0],
        "F1@.75": score.f1[1],
        "over": score.over_segmentation,
        "under": score.under_segmentation,
        **{column: _median(_known(objects, name), 1000) for column, name in _LENGTHS.items()},
        "silhouette": _median(_known(objects, "silhouette")),
        "angle deg": _median(_known(objects, "angle")),
        "coverage": _mean(_known(runs, "coverage")),
        "true coverage": _mean(_known(runs, "true_coverage")),
        "twin": _mean(_known(twins, "fidelity")),
        "penetration mm": max((1000 * value for value in _known(twins, "penetration")), default=None),
        "frame deg": max(_known(frames, "tilt"), default=None),
        "frame mm": max((1000 * abs(value) for value in _known(frames, "height")), default=None),
    }


def perception_targets(scenes: Sequence[SceneFigures]) -> list[Figure]:
    """The totals with a target, and their explanatory figures."""
    sums, objects = _summary(scenes), [item for scene in scenes for item in scene.objects]
    runs = _runs(scenes)
    coverages = [(run.coverage, run.true_coverage) for run in runs]
    coverage_errors = [100 * abs(share - true) for share, true in coverages if share is not None and true is not None]
    accepted = _known([run for run in runs if not run.refused], "true_coverage")
    right, kept = sum(run.right_segments for run in runs), sum(run.kept_segments for run in runs)
    named = [item for item in objects if item.right is not None]
    stated = [(item.confidence, bool(item.right)) for item in named if item.confidence is not None]
    motions = [(item.drift, item.tilt) for item in objects]
    moved = [max(drift / 0.005, tilt / 3) for drift, tilt in motions if drift is not None and tilt is not None]
    not_round = [item for item in objects if not item.symmetric]
    return [
        _at_least("F1 at IoU 0.5", sums["F1@.5"], 0.90),
        _at_least("mean IoU of matched", sums["IoU"], 0.85),
        _at_most("box centre, median", sums["centre mm"], 10, "mm"),
        _at_most("box size, median", sums["size mm"], 15, "mm"),
        _at_least("coverage of accepted runs, least", min(accepted, default=None), 0.8),
        _at_most("runs that refuse the scene", _total([float(bool(run.refused)) for run in runs])),
        _at_most("coverage: error of what the run says, largest", max(coverage_errors, default=None), 3, "points"),
        _at_most("robots and walls among the objects", _total(_known(runs, "fixed_as_objects")), 0),
        _at_least("right segments that survive", kept / right if right else None, 0.98),
        _at_most("CPU of the whole run, median", _median(_known(runs, "cpu_seconds")), None, "s"),
        _at_most("assets named", float(len(named))),
        _at_most("assets named: wrong", _mean([float(not item.right) for item in named])),
        _at_least(
            "objects of the library with their asset", _mean([bool(item.right) for item in objects if item.asset])
        ),
        _at_most("match confidence: expected calibration error", calibration_error(stated), 0.08),
        _at_most("match confidence above 0.9: wrong", _mean([not right for sure, right in stated if sure > 0.9]), 0.05),
        *_appearance_targets("twin", objects),
        *_appearance_targets("shapes", [item for item in objects if item.stands == "shape"]),
        _at_least("twin: pixels within 2 cm, mean", sums["twin"], 0.9),
        _at_most("twin: penetration, largest", sums["penetration mm"], 1, "mm"),
        _at_least("twin: objects that move by less than 5 mm and 3 degrees", _share(moved, below=1.0), 0.98),
        _at_most("twin: objects held on something unseen", _mean(_known(objects, "held"))),
        _at_least("shapes with a seat for the suction cup", _mean(_known(objects, "seat")), 0.95),
        _at_most("asset position, median", sums["position mm"], 10, "mm"),
        _at_most("asset angle, median of those not round", _median(_known(not_round, "angle")), 10, "deg"),
        _at_least("ADD-S below 10 % of the diameter", _share(_known(objects, "adds"), below=0.1)),
        _at_most("frame tilt, largest", sums["frame deg"], 1, "deg"),
        _at_most("frame height, largest", sums["frame mm"], 5, "mm"),
        *_times("CPU up to 640x480", 1, scenes, (0, SMALL)),
        *_times("CPU up to 1920x1080", 3, scenes, (SMALL, LARGE)),
        _at_most("peak memory, largest", max(_known(scenes, "peak_mib"), default=None), 1024, "MiB"),
    ]


def _runs(scenes: Sequence[SceneFigures]) -> list[RunFigures]:
    return [scene.run for scene in scenes if scene.run is not None]


def calibration_error(stated: Sequence[tuple[float, bool]], bins: int = 10) -> float | None:
    """The expected calibration error of answers, each with its confidence and whether it is right: how far the mean
    confidence is off the share that is right, over bins of equal width, weighted by their answers (Naeini et al.,
    "Obtaining well calibrated probabilities using Bayesian binning", AAAI 2015).
    """
    by_bin: dict[int, list[tuple[float, bool]]] = {}
    for confidence, right in stated:
        by_bin.setdefault(min(int(confidence * bins), bins - 1), []).append((confidence, right))
    off = [abs(sum(confidence - right for confidence, right in some)) for some in by_bin.values()]
    return sum(off) / len(stated) if stated else None


def _appearance_targets(name: str, objects: Sequence[ObjectFigures]) -> list[Figure]:
    """Silhouette and depth errors of the objects' stand-ins from the photo's camera."""
    outlines, depths = _known(objects, "silhouette"), _known(objects, "depth_error")
    return [
        _at_least(f"{name}: silhouette IoU, median", _median(outlines), 0.90),
        _at_least(f"{name}: silhouette IoU at least 0.85", _mean([float(iou >= 0.85) for iou in outlines]), 0.8),
        _at_most(f"{name}: depth error p90, median", _median(depths, 1000), None, "mm"),
        _at_least(f"{name}: depth error p90 below 8 mm", _share(depths, below=0.008), 0.8),
    ]


def _at_most(name: str, value: float | None, target: float | None = None, unit: str = "") -> Figure:
    return Figure(name=name, value=value, target=target, unit=unit)


def _at_least(name: str, value: float | None, target: float | None = None) -> Figure:
    return Figure(name=name, value=value, target=target, smaller_is_better=False)


def _times(name: str, target: float, scenes: Sequence[SceneFigures], pixels: tuple[int, int]) -> list[Figure]:
    """CPU time of scenes with ``pixels`` (more than, at most): the least of each scene's tries, since other load on the
    machine only adds to it."""
    least = [scene.cpu_seconds for scene in scenes if pixels[0] < scene.width * scene.height <= pixels[1]]
    return [
        _at_most(f"{name}, largest", max(least, default=None), target, "s"),
        _at_most(f"{name}, median", _median(least), target, "s"),
    ]


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
        {
            "scene": scene.name,
            **{
                key: (f"{value:.5g}" if isinstance(value, float) else value) for key, value in item.model_dump().items()
            },
        }
        for scene in scenes
        for item in scene.objects
    ]
    write_json(out / "figures.json", value)
    write_text(out / "scenes.csv", csv_text(COLUMNS, [*rows, *sums]))
    write_text(out / "objects.csv", csv_text(("scene", *ObjectFigures.model_fields), objects))
    targets = [
        {
            "figure": figure.name,
            "measured": f"{figure.value:.3g} {figure.unit}{' (missed)' if figure.is_target_met is False else ''}",
            "target": figure.format_target_value().replace("<=", "at most").replace(">=", "at least"),
        }
        for figure in figures
        if figure.value is not None
    ]
    tables = (markdown_table(("figure", "measured", "target"), targets), markdown_table(COLUMNS, [*rows, *sums]))
    write_text(out / "figures.md", "\n".join(tables))
    return value


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """The rows as CSV with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({column: escape_formula(cell) for column, cell in row.items()} for row in rows)
    return text.getvalue()


def _known(things: Sequence[object], name: str) -> list[float]:
    """Known values of an attribute."""
    return [value for thing in things if (value := getattr(thing, name, None)) is not None]


def _median(values: Sequence[float], times: float = 1.0) -> float | None:
    return times * statistics.median(values) if values else None


def _share(values: Sequence[float], below: float) -> float | None:
    return _mean([float(value < below) for value in values])


def _total(values: Sequence[float]) -> float | None:
    return float(sum(values)) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
