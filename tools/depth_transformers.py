"""Estimate the depth of a photo by your own metric depth model, through transformers. Nothing is downloaded."""

import importlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import ConfigError
from grs_agents.perception.pretrained_models import LOCAL, load_model_config, load_pretrained_model, wrap_model_errors
from grs_agents.perception.types import Image
from grs_agents.toolkit import ToolContext

METRIC = ("depth_pro", "glpn", "zoedepth")
"""Model types with metric depth; Depth Anything is metric if its ``depth_estimation_type`` says so."""


@dataclass(frozen=True)
class Request:
    """A photo without depth.

    Attributes:
        rgb: (H, W, 3) uint8.
        focal: its focal length in pixels, if known.
        photo: its name in errors.
        model: the folder of the model: ``config.json``, ``preprocessor_config.json`` and ``*.safetensors``.
    """

    rgb: Image
    focal: float | None
    photo: str
    model: str | None


@dataclass(frozen=True)
class Result:
    """The model's estimate.

    Attributes:
        depth: (H, W) float32 metres along the optical axis.
        focal: the focal length in pixels, if the model estimates it.
    """

    depth: npt.NDArray[np.float32]
    focal: float | None


def run(request: Request, context: ToolContext) -> Result:
    """Load and run the model.

    Raises:
        ConfigError: ``depth.model`` names no folder with a metric depth model, or transformers is not installed.
        InputError: the model cannot be loaded, lacks weights, or does not answer.
    """
    folder = _load_metric_model_folder(request.model)
    try:
        torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
    except ImportError as error:
        raise ConfigError(
            f"tool depth_transformers needs {error.name or 'transformers'}", 'pip install "grs-agents[transformers]"'
        ) from error
    with wrap_model_errors("depth", folder, request.photo, "AutoModelForDepthEstimation"):
        return _predict_metric_depth(request, folder, torch, transformers)


def _predict_metric_depth(request: Request, folder: Path, torch: Any, transformers: Any) -> Result:
    processor = transformers.AutoImageProcessor.from_pretrained(str(folder), **LOCAL, trust_remote_code=False)
    kind = transformers.AutoModelForDepthEstimation
    model = load_pretrained_model(kind, folder, "depth.model", transformers, trust_remote_code=False)
    with torch.inference_mode():
        answer = model(**processor(images=request.rgb, return_tensors="pt"))
    size = request.rgb.shape[:2]
    more = {"source_sizes": [size]} if model.config.model_type == "zoedepth" else {}
    found = processor.post_process_depth_estimation(answer, target_sizes=[size], **more)[0]
    depth = np.asarray(found["predicted_depth"].to(dtype=torch.float32).numpy(), dtype=np.float32)
    focal = found.get("focal_length")
    return Result(depth, None if focal is None or not math.isfinite(float(focal)) else float(focal))


def _load_metric_model_folder(name: str | None) -> Path:
    """The folder of a metric model."""
    folder, config = load_model_config("depth.model", name, "depth_transformers")
    kind = config["model_type"]
    if kind not in METRIC and config.get("depth_estimation_type") != "metric":
        raise ConfigError(
            f"depth.model = {name!r} is a {kind} model whose answers are not in metres",
            f"name a metric one: {', '.join(METRIC)}, or depth_anything of depth_estimation_type metric",
        )
    return folder
