"""Measure a scene in this process: the order is read from standard input, the result written into the named folder.

A process for each scene gives the peak memory of each, and a crash costs a single scene.
"""

import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from evals.benchmark.box_errors import frame_figures, object_figures
from evals.benchmark.ground_truth import LabelledScene, read_labelled
from evals.benchmark.scene_run import SceneRun, comprehend_scene
from evals.benchmark.segmentation_metrics import score_segmentation
from evals.benchmark.twin_figures import run_figures, twin_figures
from evals.benchmark.types import Order, Result, SceneFigures, dumped, result_file, run_folder
from grs_agents.base import content
from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import ConfigError, GrsError
from grs_agents.base.files import write_bytes, write_json
from grs_agents.base.terminal import print_escaped
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.object_finding import find_objects
from grs_agents.perception.robot_pixels import robot_pixel_mask
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Candidate, RGBDFrame, TableFrame
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import Tool, ToolContext, load_tool

_MEBIBYTE = 1024 * 1024 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class Segmented:
    """Perception of a scene: table, objects, or the reason for their absence; CPU time of finding both, s."""

    table: TableFrame | None
    candidates: Sequence[Candidate]
    error: str
    seconds: float


def measure_scene(order: Order, out: Path) -> Result:
    """Measure a scene that is there, and write its result and its segments below ``out``.

    Raises:
        GrsError: the scene or its truth cannot be read, or there is no such tool.
    """
    scene = read_labelled(Path(order.source))
    tool = load_tool(order.tool)
    cv2.setNumThreads(1)
    with Sandbox() as sandbox:
        context = ToolContext(sandbox=sandbox, library=Library(), limits=Limits())
        tries = [_segment_scene(scene, tool, context, order) for _ in range(order.repeats)]
    segmented = min(tries, key=lambda attempt: attempt.seconds)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEBIBYTE
    labels = np.zeros(scene.labels.shape, np.int32)
    for candidate in segmented.candidates:
        labels[candidate.mask] = candidate.id
    labels[scene.unlabelled] = 0
    figures = _measure_figures(order, scene, labels, segmented, out).model_copy(
        update={"cpu_seconds": segmented.seconds, "peak_mib": peak}
    )
    table = segmented.table
    boxes = (
        {candidate.id: _box_corners(candidate, table) for candidate in segmented.candidates}
        if table is not None
        else {}
    )
    result = Result(order=order, figures=figures, boxes=boxes)
    file = result_file(out, order.name)
    write_bytes(file.with_suffix(".png"), cv2.imencode(".png", labels.astype(np.uint16))[1].tobytes())
    write_json(file, dumped(result))
    return result


def _segment_scene(scene: LabelledScene, tool: Tool, context: ToolContext, order: Order) -> Segmented:
    seconds = 0.0
    table: TableFrame | None = None
    candidates: Sequence[Candidate] = ()
    error = ""

    def segment(photo: RGBDFrame) -> Sequence[Candidate]:
        nonlocal seconds
        config = {"config": DEFAULT.segmentation.without_rules(*order.without)} if order.without else {}
        begin = time.process_time()
        objects = tool.run(tool.Request(frame=photo, table=table, model=order.model, **config), context).candidates
        seconds += time.process_time() - begin
        return objects

    try:
        begin = time.process_time()
        table = find_table(scene.frame, np.random.default_rng(order.seed))
        seconds = time.process_time() - begin
        if order.without and not hasattr(tool.Request, "config"):
            raise ConfigError(f"tool {order.tool} has no rules that can be off", "leave out --without")
        robot = robot_pixel_mask(scene.frame, load_config(None, _settings(order)).config.robot, context.library)
        candidates = find_objects(scene.frame, table, robot, segment).objects
    except GrsError as failure:
        error = failure.message
    return Segmented(table, candidates, error, seconds)


def _measure_figures(
    order: Order, scene: LabelledScene, labels: npt.NDArray[np.int32], segmented: Segmented, out: Path
) -> SceneFigures:
    frame, error, library = None, segmented.error, Library()
    try:
        frame = frame_figures(scene, np.random.default_rng(order.seed))
    except GrsError as failure:
        error = error or f"without calibration: {failure.message}"
    run: SceneRun | None = None
    try:
        if not segmented.error and not order.without:
            run = comprehend_scene(order.source, run_folder(out, order.name), _settings(order))
    except GrsError as failure:
        error = f"run: {failure.message}"
    stands = {} if run is None else twin_figures(scene, run, library)
    return SceneFigures(
        name=order.name,
        sensor=scene.truth.sensor,
        tilt=scene.truth.tilt,
        score=score_segmentation(labels, scene.labels, scene.ignored()),
        objects=object_figures(scene, labels, segmented.candidates, library, segmented.table, stands),
        frame=frame,
        run=None if run is None else run_figures(scene, labels, run),
        twin=None if run is None else run.scene.twin,
        width=scene.frame.camera.width,
        height=scene.frame.camera.height,
        error=error,
    )


def _settings(order: Order) -> list[str]:
    """Settings of the run."""
    model = [f"segment.model={order.model}"] if order.model else []
    return [f"tools.segment={order.tool}", f"seed={order.seed}", *model, *order.settings]


def _box_corners(candidate: Candidate, table: TableFrame) -> tuple[tuple[float, ...], ...]:
    """The corners of the upright box, (8, 3) m, camera frame."""
    box = candidate.upright
    cosine, sine = np.cos(box.yaw), np.sin(box.yaw)
    unit = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners = unit * box.size @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + box.center
    pose = np.array(table.T_robot_cam)
    return tuple(tuple(round(float(v), 4) for v in row) for row in (corners - pose[:3, 3]) @ pose[:3, :3])


def make_scene(order: Order) -> None:
    """Synthesise the folder that the order names, if it is not there.

    Raises:
        SynthesisError: the scene cannot be made.
    """
    if order.recipe is not None and not (Path(order.source) / "truth.json").exists():
        from evals.synthesis.scene import synthesise

        synthesise(order.recipe, Library()).write(Path(order.source))


def main(arguments: Sequence[str]) -> int:
    """``make``, ``measure`` or ``comprehend``, and the folder for results; the order is read from standard input.

    Returns:
        0, or the error's exit status.
    """
    verb, out = arguments
    order = Order.model_validate_json(sys.stdin.read())
    for root in reversed(order.content):
        content.add_overlay_folder(Path(root))
    try:
        if verb == "make":
            make_scene(order)
        elif verb == "measure":
            measure_scene(order, Path(out))
        else:
            comprehend_scene(order.source, run_folder(Path(out), order.name), order.settings)
    except GrsError as error:
        print_escaped(error, error=True)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
