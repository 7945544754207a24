"""What is measured of one scene."""

from pathlib import Path
from typing import Any

from pydantic import Field

from evals.benchmark.segmentation_metrics import SegmentationScore
from evals.synthesis.scene import Recipe
from grs_agents.base import Frozen
from grs_agents.perception.types import TwinReport

Corners = tuple[tuple[float, ...], ...]


class ObjectFigures(Frozen):
    """What became of one object; ``None`` is what cannot be said of it. Lengths in m, angles in degrees.

    Attributes:
        id: its label.
        asset, kind: library name, and what it is; or empty.
        visible: share of it that is seen, if that is known.
        iou: intersection over union with the segment assigned to it, 0 without one.
        segment: that segment's number.
        center: distance of the centres of the measured and the true axis-aligned box.
        size: largest difference of an extent of the two.
        stands: what stands for it in the twin: ``asset``, or ``shape`` where none does; empty where nothing does.
        right: the asset is the true one.
        confidence: of the match that named the asset.
        silhouette: of what stands for it, at rest, seen by the photo's camera: intersection over union with its pixels.
        depth_error: there, where both are seen, the 90th percentile.
        position, angle: error of the pose at which the right asset rests; the angle up to the asset's symmetry.
        symmetric: any turn about some axis leaves the asset as it is.
        adds: of the right asset, mean distance of the true surface to the placed one, as a share of the diameter.
        drift, tilt: how far what stands for it moves, and how far it tilts (degrees), until the twin is at rest.
        seat: the suction cup finds a place to hold the shape, alone on the table.
        held: it would have fallen, and may stand on something that the photo does not show: in the twin it stays.
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
    """How a robot frame that was laid on the table without calibration agrees with the calibrated one.

    Attributes:
        tilt: angle between both vertical axes, degrees.
        height: how far the found table top lies above the true one, below the middle of the objects, m.
    """

    tilt: float
    height: float


class RunFigures(Frozen):
    """What a run made of a scene.

    Attributes:
        coverage, true_coverage: share of what rises above the table that objects own, as the run says; share of the
            true objects' measured pixels that they own.
        refused: why the run did not accept the scene; empty if it did.
        fixed_as_objects: objects that are mostly robot or wall; ``None`` where nobody says what is.
        right_segments, kept_segments: true objects that a segment matches, and those of them that an object of the twin
            matches too.
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
    """The figures of one scene.

    Attributes:
        name, sensor, tilt: which scene.
        score: of the segmentation.
        objects: one entry for each true object that counts.
        frame: without calibration, where the calibration is known.
        run: what a whole run made of it, and twin: how that stands in MuJoCo; ``None`` where there is none.
        cpu_seconds: from the frame to the candidates, on one core, the least of several tries.
        peak_mib: memory of the process that did so, imports included.
        width, height: of the picture.
        error: why there are no segments, or no frame without calibration.
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
    """One scene to measure, in a process of its own.

    Attributes:
        name: how it is called in tables.
        source: a scene folder with labels, or ``bop:`` and an image.
        recipe: what the folder is synthesised from, if it is not there yet.
        tool: the segment tool.
        model: the folder of its model, if it has one.
        without: rules of segmentation that are off.
        seed: of the search for the table.
        settings: of the configuration of the run, ``KEY=VALUE``.
        repeats: how often the work is timed.
        content: content folders laid over the shipped ones, the one that wins first.
        fingerprint: of everything else that the figures depend on; a result with another one is measured again.
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
    """What a measured scene leaves in ``scenes/NAME.json``.

    Attributes:
        order: what was asked.
        figures: what was measured.
        boxes: of the candidates, for pictures: corners (8 x 3 m, camera frame) by number.
    """

    order: Order
    figures: SceneFigures
    boxes: dict[int, Corners] = Field(default_factory=dict[int, Corners])


def dumped(result: Result) -> dict[str, Any]:
    """The result as plain JSON."""
    return result.model_dump(mode="json")


def result_file(out: Path, name: str) -> Path:
    """Where the result of a scene is kept; ``NAME.png`` beside it holds the segments."""
    return out / "scenes" / f"{name}.json"


def run_folder(out: Path, name: str) -> Path:
    """Where the run of a scene and the pictures of its twin are kept."""
    return out / "runs" / name
