"""Segment a photo by the masks of your own SAM 2, merged by depth. Nothing is downloaded."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT, Segmentation
from grs_agents.perception.pretrained_models import wrap_model_errors
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.model_proposals import Proposal, segment_from_proposals
from grs_agents.perception.segmentation.sam2_models import AskAtPoints, load_sam2
from grs_agents.perception.types import Candidate, Image, Mask, RGBDFrame, TableFrame
from grs_agents.toolkit import ToolContext

Floats = npt.NDArray[np.float32]
SIDE = 32
"""Rows and columns of the grid of prompt points, of which those that may show an object are used."""
SCORE = 0.8
"""Least intersection over union with the truth, as estimated by the model."""
STABILITY = 0.95
"""Least intersection over union of a mask at thresholds `OFFSET` above and below."""
OFFSET = 1.0
CPU_SECONDS = "75 to 170"
"""CPU time of a photo of 640 x 480, from the smallest model to the largest."""


@dataclass(frozen=True)
class Request:
    """A frame and the table in it.

    Attributes:
        frame: the photo.
        table: the table in it.
        model: a folder with ``config.json`` and ``*.safetensors``, one with an encoder and a decoder in ONNX, or a
            ``.pt`` of Meta's.
        device: where it runs, as torch names it.
        batch: points per call; the masks of 16 are a few ten MiB.
        config: constants of the segmentation.
    """

    frame: RGBDFrame
    table: TableFrame
    model: str | None = None
    device: str = "cpu"
    batch: int = 16
    config: Segmentation = DEFAULT.segmentation


@dataclass(frozen=True)
class Result:
    """The candidates, in the table's frame."""

    candidates: tuple[Candidate, ...]


def run(request: Request, context: ToolContext) -> Result:
    """Load the model, prompt it, and measure the objects on the table.

    Raises:
        ConfigError: ``segment.model`` names no SAM 2, or its runtime is not installed.
        InputError: the model cannot be loaded, lacks weights, does not answer, or sees nothing on the table.
    """
    with wrap_model_errors("segmentation", Path(request.model or ""), request.frame.source, "Sam2Model"):
        embed = load_sam2(request.model, request.device)

        def propose_stable_masks(rgb: Image, where: Mask) -> Iterator[Proposal]:
            points = _make_grid_points(where)
            cost = f", which takes {CPU_SECONDS} CPU seconds a photo" if request.device == "cpu" else ""
            context.say(f"asks SAM 2 at {len(points)} points{cost}")
            return _generate_stable_masks(embed(rgb), points, (where.shape[1], where.shape[0]), request.batch)

        labels = segment_from_proposals(request.frame, request.table, propose_stable_masks, request.config)
    return Result(measure_candidates(request.frame, request.table, labels))


def _generate_stable_masks(ask: AskAtPoints, points: Floats, size: tuple[int, int], batch: int) -> Iterator[Proposal]:
    """The good and stable masks of all points, of ``size`` (columns, rows)."""
    for start in range(0, len(points), batch):
        logits, scores = ask(points[start : start + batch])
        for at in map(tuple, np.argwhere(scores >= SCORE)):
            whole = cv2.resize(logits[at], size, interpolation=cv2.INTER_LINEAR)
            inner, outer = np.count_nonzero(whole > OFFSET), np.count_nonzero(whole > -OFFSET)
            if inner >= STABILITY * max(outer, 1):
                yield Proposal(whole > 0, float(scores[at]))


def _make_grid_points(where: Mask) -> Floats:
    """(N, 2) points across and down, 0..1, of the grid's cells that hold any pixel of ``where``."""
    rows, columns = np.nonzero(where)
    down, across = rows * SIDE // where.shape[0], columns * SIDE // where.shape[1]
    cells = np.unique(down * SIDE + across)
    return (np.stack([cells % SIDE + 0.5, cells // SIDE + 0.5], axis=-1) / SIDE).astype(np.float32)
