"""Segment a photo by your own open-vocabulary detector; depth fills its boxes. Nothing is downloaded."""

import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from grs_agents.base.errors import ConfigError
from grs_agents.perception.configuration import DEFAULT, Segmentation
from grs_agents.perception.pretrained_models import LOCAL, load_model_config, load_pretrained_model, wrap_model_errors
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.model_proposals import Proposal, segment_from_proposals
from grs_agents.perception.types import Candidate, Image, Mask, RGBDFrame, TableFrame
from grs_agents.toolkit import ToolContext

KINDS = ("grounding-dino", "mm-grounding-dino", "owlv2", "owlvit")


@dataclass(frozen=True)
class Request:
    """A frame, the table in it, and prompts.

    Attributes:
        frame: the photo.
        table: the table in it.
        model: the folder of the detector: ``config.json``, ``*.safetensors`` and the files of its processor.
        device: where it runs, as torch names it.
        prompts: names of objects that may stand on the table; the categories of the library if empty.
        config: constants of the segmentation.
    """

    frame: RGBDFrame
    table: TableFrame
    model: str | None = None
    device: str = "cpu"
    prompts: tuple[str, ...] = ()
    config: Segmentation = DEFAULT.segmentation


@dataclass(frozen=True)
class Result:
    """The candidates, in the table's frame."""

    candidates: tuple[Candidate, ...]


def run(request: Request, context: ToolContext) -> Result:
    """Load the detector, ask it, and measure what it sees on the table.

    Raises:
        ConfigError: ``segment.model`` names no folder with such a detector, or transformers is not installed.
        InputError: the model cannot be loaded, lacks weights, does not answer, or nothing is on the table.
    """
    folder, config = load_model_config("segment.model", request.model, "segment_grounded")
    if config["model_type"] not in KINDS:
        found = f"segment.model = {request.model!r} is a {config['model_type']} model"
        raise ConfigError(found, f"name a detector of one of these kinds: {', '.join(KINDS)}")
    try:
        torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
    except ImportError as error:
        raise ConfigError(
            f"tool segment_grounded needs {error.name or 'transformers'}", 'pip install "grs-agents[transformers]"'
        ) from error
    prompts = request.prompts or tuple(sorted({asset.category for asset in context.library.everyday_assets()}))
    kind = transformers.AutoModelForZeroShotObjectDetection
    with wrap_model_errors("detection", folder, request.frame.source, kind.__name__):
        processor = transformers.AutoProcessor.from_pretrained(str(folder), **LOCAL, trust_remote_code=False)
        model = load_pretrained_model(kind, folder, "segment.model", transformers, trust_remote_code=False)

        def propose_boxes(rgb: Image, where: Mask) -> Iterator[Proposal]:
            with torch.inference_mode():
                return _detect_boxes(model.float().to(request.device), processor, rgb, where, prompts)

        labels = segment_from_proposals(request.frame, request.table, propose_boxes, request.config)
    return Result(measure_candidates(request.frame, request.table, labels))


def _detect_boxes(model: Any, processor: Any, rgb: Image, where: Mask, prompts: tuple[str, ...]) -> Iterator[Proposal]:
    """The boxes above the detector's default threshold."""
    asked = processor(images=rgb, text=[list(prompts)], return_tensors="pt").to(model.device)
    answer = processor.post_process_grounded_object_detection(model(**asked), target_sizes=[where.shape])[0]
    found: list[Proposal] = []
    for box, score in zip(answer["boxes"].cpu().numpy(), answer["scores"].cpu().numpy(), strict=True):
        left, top, right, bottom = np.rint(box).clip(0).astype(int)
        mask = np.zeros(where.shape, np.bool_)
        mask[top:bottom, left:right] = True
        found.append(Proposal(mask, float(score), is_box=True))
    return iter(found)
