"""What is measured of one scene."""

from pathlib import Path
from typing import Any

from pydantic import Field

from evals.benchmark.segmentation_metrics import SegmentationScore
from evals.synthesis.scene import Recipe
from grs_agents.base import Frozen
from grs_agents.perception import TwinReport

Corners = tuple[tuple[float, ...], ...]


class ObjectFigures(Frozen):
    """What became of one object; ``None`` is what cannot be said of it. Lengths in m, angles in degrees.

    Attributes:
        id: its label.
        asset: library name, or empty.
        visible: share of it that is seen, if that is known.
        iou: intersection over union with the segment assigned to it, 0 without one.
        segment: that segment's number.
        center: distance of the centres of the measured and the true axis-aligned box.
        size: largest difference of an extent of the two.
        position, angle: error of the pose at which its asset is placed; the angle up to the asset's symmetry.
        symmetric: any turn about some axis leaves the asset as it is.
        residual: how far its points are off the asset's surface.
        method: ``registered``, or ``box`` where the asset is laid into the measured box.
        drift: how far what stands for it moves until the twin is at rest.
        held: it would have fallen, and may stand on something that the photo does not show: in the twin it stays.
    """

    id: int
    asset: str = ""
    visible: float | None = None
    iou: float = 0.0
    segment: int | None = None
    center: float | None = None
    size: float | None = None
    position: float | None = None
    angle: float | None = None
    symmetric: bool | None = None
    residual: float | None = None
    method: str = ""
    drift: float | None = None
    held: bool | None = None


class FrameFigures(Frozen):
    """How a robot frame that was laid on the table without calibration agrees with the calibrated one.

    Attributes:
        tilt: angle between both vertical axes, degrees.
        height: how far the found table top lies above the true one, below the middle of the objects, m.
    """

    tilt: float
    height: float


class SceneFigures(Frozen):
    """The figures of one scene.

    Attributes:
        name, sensor, tilt: which scene.
        score: of the segmentation.
        objects: one entry for each true object that counts.
        frame: without calibration, where the calibration is known.
        twin: how the scene stands in MuJoCo, where true assets are known; its objects' pixels are the true ones.
        cpu_seconds: from the frame to the candidates, on one core, the least of several tries.
        cpu_median: their median.
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
    twin: TwinReport | None = None
    cpu_seconds: float = 0.0
    cpu_median: float = 0.0
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
