"""Measurements of a scene."""

from pathlib import Path
from typing import Any

from pydantic import Field

from evals.benchmark.segmentation_metrics import SegmentationScore
from evals.synthesis.scene import Recipe
from grs_agents.base import Frozen
from grs_agents.perception.types import TwinReport

Corners = tuple[tuple[float, ...], ...]


class ObjectFigures(Frozen):
    """The figures of an object; ``None`` if unknown. Lengths in m, angles in degrees.

    Attributes:
        id: its label.
        asset, kind: library name, and a word for it; or empty.
        visible: visible share, if known.
        iou: intersection over union with the assigned segment, 0 without a segment.
        segment: number of that segment.
        center: distance of the centres of the measured and the true axis-aligned box.
        size: largest difference of an extent of the two.
        stands: its stand-in in the twin: ``asset``, or ``shape`` without a match; empty without a stand-in.
        right: the asset is the true asset.
        confidence: of the match that named the asset.
        silhouette: of its stand-in, at rest, from the photo's camera: intersection over union with its pixels.
        depth_error: 90th percentile of the depth error on the common pixels.
        position, angle: pose error of the right asset at rest; the angle up to the asset's symmetry.
        symmetric: the asset is a body of revolution.
        adds: of the right asset, mean distance of the true surface to the placed surface, as a share of the diameter.
        drift, tilt: translation and tilt (degrees) of its stand-in until the twin is at rest.
        seat: the suction cup finds a place to hold the shape, alone on the table.
        held: it would have fallen without a support that the photo does not show: in the twin it is fixed.
    """

    id: int
    asset: str = ""
    kind: str = ""
    visible: float | None = None
    iou: float = 0.0
    segment: int | None = None
    center: float | None = None
    size: float | None = None
    stands: str = ""
    right: bool | None = None
    confidence: float | None = None
    silhouette: float | None = None
    depth_error: float | None = None
    position: float | None = None
    angle: float | None = None
    symmetric: bool | None = None
    adds: float | None = None
    drift: float | None = None
    tilt: float | None = None
    seat: bool | None = None
    held: bool | None = None


class FrameFigures(Frozen):
    """Agreement of a robot frame laid on the table without calibration with the calibrated frame.

    Attributes:
        tilt: angle between both vertical axes, degrees.
        height: height of the found table top above the true table top, below the middle of the objects, m.
    """

    tilt: float
    height: float


class RunFigures(Frozen):
    """The figures of a run on a scene.

    Attributes:
        coverage, true_coverage: share of everything above the table that belongs to objects, as measured by the run;
            share of the true objects' measured pixels that belongs to objects.
        refused: reason of a rejection; empty if accepted.
        fixed_as_objects: objects that are mostly robot or wall; ``None`` if unknown.
        right_segments, kept_segments: true objects matched by a segment; and, of these, by an object of the twin too.
        cpu_seconds: of the whole run, offline models included.
    """

    coverage: float | None = None
    true_coverage: float | None = None
    refused: str = ""
    fixed_as_objects: int | None = None
    right_segments: int = 0
    kept_segments: int = 0
    cpu_seconds: float = 0.0


class SceneFigures(Frozen):
    """The figures of a scene.

    Attributes:
        name, sensor, tilt: of the scene.
        score: of the segmentation.
        objects: an entry for each true object that counts.
        frame: without calibration, if the calibration is known.
        run: of a whole run, and twin: of its twin in MuJoCo; ``None`` without a run.
        cpu_seconds: from the frame to the candidates, on a single core, the minimum of several repetitions.
        peak_mib: memory of the process, imports included.
        width, height: of the picture.
        error: reason for missing segments, or for a missing frame without calibration.
    """

    name: str
    sensor: str = ""
    tilt: float | None = None
    score: SegmentationScore
    objects: tuple[ObjectFigures, ...] = ()
    frame: FrameFigures | None = None
    run: RunFigures | None = None
    twin: TwinReport | None = None
    cpu_seconds: float = 0.0
    peak_mib: float = 0.0
    width: int = 0
    height: int = 0
    error: str = ""


class Order(Frozen):
    """A scene to measure, in a separate process.

    Attributes:
        name: in tables.
        source: a scene folder with labels, or ``bop:`` and an image.
        recipe: for the synthesis of a missing folder.
        tool: the segment tool.
        model: the folder of its model, if it has a model.
        without: disabled rules of segmentation.
        seed: of the table search.
        settings: of the configuration of the run, ``KEY=VALUE``.
        repeats: number of timings.
        content: content folders overlaid on the shipped content, in order of precedence.
        fingerprint: of everything else that the figures depend on; a result with another fingerprint is measured again.
    """

    name: str
    source: str
    recipe: Recipe | None = None
    tool: str
    model: str | None = None
    without: tuple[str, ...] = ()
    seed: int = 0
    settings: tuple[str, ...] = ()
    repeats: int = 1
    content: tuple[str, ...] = ()
    fingerprint: str = ""


class Result(Frozen):
    """The content of ``scenes/NAME.json``.

    Attributes:
        order: the order.
        figures: the measurements.
        boxes: of the candidates, for pictures: corners (8 x 3 m, camera frame) by number.
    """

    order: Order
    figures: SceneFigures
    boxes: dict[int, Corners] = Field(default_factory=dict[int, Corners])


def dumped(result: Result) -> dict[str, Any]:
    """The result as plain JSON."""
    return result.model_dump(mode="json")


def result_file(out: Path, name: str) -> Path:
    """File of a scene's result; ``NAME.png`` beside it holds the segments."""
    return out / "scenes" / f"{name}.json"


def run_folder(out: Path, name: str) -> Path:
    """Folder of a scene's run and the pictures of its twin."""
    return out / "runs" / name
