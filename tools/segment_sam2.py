"""Segment a photo by the masks of a SAM 2 of your own, through transformers, merged by depth. Nothing is downloaded."""

import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.errors import ConfigError
from grs_agents.perception import (
    DEFAULT,
    Candidate,
    Image,
    Mask,
    Proposal,
    RGBDFrame,
    Segmentation,
    TableFrame,
    load_model_config,
    load_pretrained_model,
    measure_candidates,
    segment_from_proposals,
    wrap_model_errors,
)
from grs_agents.toolkit import ToolContext

KINDS = ("sam2", "sam2_video")
"""Kinds of model that hold a SAM 2; of one for videos, what tracks from picture to picture is left out."""
SIDE = 32
"""The model is asked at the points of a grid with so many rows and columns that may be on a thing."""
BATCH = 16
"""So many points at once: the masks of one batch are a few ten MiB."""
SCORE = 0.8
"""Masks are taken whose intersection over union with the truth the model estimates to be at least this."""
STABILITY = 0.95
"""And which a change of the threshold by `OFFSET` changes by at most 1 - this."""
OFFSET = 1.0
MEAN = (0.485, 0.456, 0.406)
"""Mean and standard deviation of red, green and blue (0..1) that SAM 2's training took for its pictures'."""
DEVIATION = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Request:
    """A frame and the table in it.

    Attributes:
        frame: the photo.
        table: the table in it.
        model: the folder of the model: ``config.json`` and ``*.safetensors``.
        config: how parts are merged.
    """

    frame: RGBDFrame
    table: TableFrame
    model: str | None = None
    config: Segmentation = DEFAULT.segmentation


@dataclass(frozen=True)
class Result:
    """The candidates, in the table's frame."""

    candidates: tuple[Candidate, ...]


def run(request: Request, context: ToolContext) -> Result:
    """Load the model, ask it, and measure what it sees on the table.

    Raises:
        ConfigError: ``segment.model`` names no folder with a SAM 2, or transformers is not installed.
        InputError: the model cannot be loaded, lacks weights, does not answer, or sees nothing on the table.
    """
    folder = _sam2(request.model)
    try:
        torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
        kind = transformers.Sam2Model
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            "tool segment_sam2 needs torch and transformers of at least 4.56", 'pip install "grs-agents[sam2]"'
        ) from error

    def proposals(rgb: Image, where: Mask) -> Iterator[Proposal]:
        model = load_pretrained_model(kind, folder, "segment.model", transformers).float()
        with torch.inference_mode():
            yield from _automatic(model, rgb, where, torch)

    with wrap_model_errors("segmentation", folder, request.frame.source, "Sam2Model"):
        labels = segment_from_proposals(request.frame, request.table, proposals, request.config)
    return Result(measure_candidates(request.frame, request.table, labels))


def _automatic(model: Any, rgb: Image, where: Mask, torch: Any) -> Iterator[Proposal]:
    """The good and stable masks of all points of the grid, whose cell is not wholly out of ``where``."""
    side = int(model.config.prompt_encoder_config.image_size)
    embeddings = model.get_image_embeddings(_pixels(rgb, side, torch))
    points = torch.from_numpy(_grid(where) * side).float()[None, :, None]
    rows, columns = where.shape
    for start in range(0, points.shape[1], BATCH):
        answer = model(input_points=points[:, start : start + BATCH], image_embeddings=embeddings)
        scores = answer.iou_scores[0].flatten()
        good = (scores >= SCORE).nonzero()[:, 0]
        logits = answer.pred_masks[0].flatten(0, 1)[good]
        if len(good) == 0:
            continue
        whole = torch.nn.functional.interpolate(logits[None], (rows, columns), mode="bilinear", align_corners=False)[0]
        inner, outer = (whole > OFFSET).sum((1, 2)), (whole > -OFFSET).sum((1, 2))
        for number in (inner >= STABILITY * outer.clamp(min=1)).nonzero()[:, 0].tolist():
            yield Proposal((whole[number] > 0).numpy(), float(scores[good[number]]))


def _pixels(rgb: Image, side: int, torch: Any) -> Any:
    """The photo as SAM 2 takes it: (1, 3, side, side), whatever its own shape, of mean 0 and deviation 1."""
    picture = torch.from_numpy(np.ascontiguousarray(rgb)).permute(2, 0, 1)[None].float() / 255
    picture = torch.nn.functional.interpolate(
        picture, (side, side), mode="bilinear", align_corners=False, antialias=True
    )
    return (picture - torch.tensor(MEAN).view(3, 1, 1)) / torch.tensor(DEVIATION).view(3, 1, 1)


def _grid(where: Mask) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """(N, 2) points across and down, 0..1, of the grid's cells that hold any pixel of ``where``."""
    rows, columns = np.nonzero(where)
    down, across = rows * SIDE // where.shape[0], columns * SIDE // where.shape[1]
    cells = np.unique(down * SIDE + across)
    return np.stack([cells % SIDE + 0.5, cells // SIDE + 0.5], axis=-1) / SIDE


def _sam2(name: str | None) -> Path:
    """The folder of a SAM 2."""
    folder, config = load_model_config("segment.model", name, "segment_sam2")
    if config["model_type"] not in KINDS:
        kinds = ", ".join(KINDS)
        raise ConfigError(f"segment.model = {name!r} is a {config['model_type']} model", f"name a SAM 2: {kinds}")
    return folder
