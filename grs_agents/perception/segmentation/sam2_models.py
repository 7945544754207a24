"""The user's SAM 2, loaded from disk in any of three formats: transformers, Meta's checkpoint, ONNX."""

import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import ConfigError, InputError
from grs_agents.perception.pretrained_models import load_model_config, load_pretrained_model, wrap_model_errors
from grs_agents.perception.types import Image, Mask, RGBDFrame

Floats = npt.NDArray[np.float32]
AskAtPoints = Callable[[Floats], tuple[Floats, Floats]]
"""Maps (N, 2) points, or (N, 2, 2) upper left and lower right corners of boxes, to (N, M, h, w) logits and (N, M)
estimated intersections over union of M masks a prompt; across and down, 0..1 of the photo."""
Embed = Callable[[Image], AskAtPoints]
"""Embeds a photo; the result is prompted with points or boxes."""

KINDS = ("sam2", "sam2_video")
"""Model types of transformers that hold a SAM 2; the tracker of a video model is left out."""
MEAN = np.array((0.485, 0.456, 0.406), np.float32)
"""Mean and standard deviation of red, green and blue (0..1) in SAM 2's training."""
DEVIATION = np.array((0.229, 0.224, 0.225), np.float32)
EXTRA = 'pip install "grs-agents[sam2]"'


@dataclass(frozen=True)
class Hiera:
    """Hyperparameters of the image encoder that Meta's checkpoints do not hold."""

    stages: tuple[int, ...]  # blocks of each stage
    attends_all: tuple[int, ...]  # blocks whose attention is not bound to a window
    windows: tuple[int, ...] = (8, 4, 14, 7)  # side of a window, by stage


SIZES: Mapping[int, Hiera] = {
    12: Hiera((1, 2, 7, 2), (5, 7, 9)),
    16: Hiera((1, 2, 11, 2), (7, 10, 13)),
    24: Hiera((2, 3, 16, 3), (12, 16, 20)),
    48: Hiera((2, 6, 36, 4), (23, 33, 43), (8, 4, 16, 8)),
}
"""Tiny, small, base plus and large, of SAM 2 and 2.1, by the number of their blocks."""

HEADS = ("output_hypernetworks_mlps.", "iou_prediction_head.", "pred_obj_score_head.")
RENAMED = (
    (r"^image_encoder\.trunk\.", "vision_encoder.backbone."),
    (r"^image_encoder\.neck\.convs\.(\d)\.conv\.", r"vision_encoder.neck.convs.\1."),
    (r"^sam_(prompt_encoder|mask_decoder)\.", r"\1."),
    (r"^no_mem_embed$", "no_memory_embedding"),
    (r"\.patch_embed\.proj\.", ".patch_embed.projection."),
    (r"\.norm(\d|_final_attn)\.", r".layer_norm\1."),
    (r"\.out_proj\.", ".o_proj."),
    (r"\.mlp\.layers\.0\.", ".mlp.proj_in."),
    (r"\.mlp\.layers\.1\.", ".mlp.proj_out."),
    (r"\.output_upscaling\.0\.", ".upscale_conv1."),
    (r"\.output_upscaling\.1\.", ".upscale_layer_norm."),
    (r"\.output_upscaling\.3\.", ".upscale_conv2."),
    (r"\.mask_downscaling\.0\.", ".mask_embed.conv1."),
    (r"\.mask_downscaling\.1\.", ".mask_embed.layer_norm1."),
    (r"\.mask_downscaling\.3\.", ".mask_embed.conv2."),
    (r"\.mask_downscaling\.4\.", ".mask_embed.layer_norm2."),
    (r"\.mask_downscaling\.6\.", ".mask_embed.conv3."),
    (r"\.pe_layer\.positional_encoding_gaussian_matrix$", ".shared_embedding.positional_embedding"),
)
"""Patterns of weight names in Meta's checkpoints, and their names in transformers."""
HEAD_LAYERS = {"0": "proj_in", "1": "layers.0", "2": "proj_out"}
TRACKING = ("memory_", "mask_downsample.", "obj_ptr", "maskmem_", "no_obj_", "no_mem_pos_enc")
"""Prefixes of weights that only video tracking needs."""


_PROMPTED: WeakKeyDictionary[RGBDFrame, tuple[tuple[str | None, str], AskAtPoints]] = WeakKeyDictionary()


def segment_rectangle_with_sam2(
    frame: RGBDFrame, window: tuple[slice, slice], model: str | None, device: str
) -> Mask | None:
    """(H, W) mask of the object in a rectangle, by a SAM 2 prompted with it; the photo is embedded once.

    Args:
        frame: the photo.
        window: rows and columns of the rectangle.
        model: as `load_sam2` takes it.
        device: where it runs.

    Returns:
        None if the model sees no object in the rectangle.

    Raises:
        ConfigError: as `load_sam2`.
        InputError: the model cannot be loaded, or does not answer.
    """
    height, width = frame.depth.shape
    rows, columns = window
    with wrap_model_errors("segmentation", Path(model or ""), frame.source, "Sam2Model"):
        prompted = _PROMPTED.get(frame)
        if prompted is None or prompted[0] != (model, device):
            prompted = _PROMPTED[frame] = (model, device), load_sam2(model, device)(frame.rgb)
        box = ((columns.start / width, rows.start / height), (columns.stop / width, rows.stop / height))
        logits, scores = prompted[1](np.array([box], np.float32))
    logit: Floats = logits[0, int(scores[0].argmax())]
    best = cv2.resize(logit, (width, height), interpolation=cv2.INTER_LINEAR)
    mask = np.zeros((height, width), np.bool_)
    mask[window] = np.asarray(best, np.float32)[window] > 0
    return mask if mask.any() else None


def load_sam2(model: str | None, device: str) -> Embed:
    """The SAM 2 that ``segment.model`` names: a folder that transformers wrote, a ``.pt`` of Meta's, or a folder with
    an encoder and a decoder in ONNX.

    Raises:
        ConfigError: it is none of them, or its runtime is not installed.
        InputError: weights are missing.
    """
    place = Path(model or "")
    if model is not None and place.is_dir() and not (place / "config.json").exists() and any(place.glob("*.onnx")):
        return _load_onnx_encoder_and_decoder(place, device)
    is_checkpoint = place.suffix == ".pt"
    if not is_checkpoint:
        place, config = load_model_config("segment.model", model, "segment_sam2")
        if config["model_type"] not in KINDS:
            kinds = ", ".join(KINDS)
            raise ConfigError(f"segment.model = {model!r} is a {config['model_type']} model", f"name a SAM 2: {kinds}")
    elif not place.is_file():
        raise ConfigError(f"segment.model = {model!r}: there is no such file", "name a checkpoint on this machine")
    try:
        torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
        kind = transformers.Sam2Model
    except (ImportError, AttributeError) as error:
        raise ConfigError("tool segment_sam2 needs torch and transformers of at least 4.56", EXTRA) from error
    found = (
        _read_checkpoint(place, torch, transformers)
        if is_checkpoint
        else load_pretrained_model(kind, place, "segment.model", transformers)
    )
    return _wrap_torch_model(found.float().to(device), torch)


def _wrap_torch_model(model: Any, torch: Any) -> Embed:
    side = int(model.config.prompt_encoder_config.image_size)

    def embed(rgb: Image) -> AskAtPoints:
        with torch.inference_mode():
            embeddings = model.get_image_embeddings(torch.from_numpy(_normalize_photo(rgb, side)).to(model.device))

        def ask(points: Floats) -> tuple[Floats, Floats]:
            prompts, labels = (torch.from_numpy(part).to(model.device)[None] for part in _label_prompts(points * side))
            with torch.inference_mode():
                answer = model(input_points=prompts, input_labels=labels, image_embeddings=embeddings)
            return answer.pred_masks[0].cpu().numpy(), answer.iou_scores[0].cpu().numpy()

        return ask

    return embed


def _label_prompts(prompts: Floats) -> tuple[Floats, npt.NDArray[np.int64]]:
    """(N, P, 2) points and their (N, P) labels: 1 of an object's point, 2 and 3 of a box's corners, as SAM 2 has it."""
    if prompts.ndim == 2:
        return prompts[:, None], np.ones((len(prompts), 1), np.int64)
    return prompts, np.tile(np.array((2, 3), np.int64), (len(prompts), 1))


def _normalize_photo(rgb: Image, side: int) -> Floats:
    """The photo as SAM 2 takes it: (1, 3, side, side), whatever its own shape, of mean 0 and deviation 1."""
    shrinks = max(rgb.shape[:2]) > side
    picture = cv2.resize(rgb, (side, side), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    scaled = (picture / 255 - MEAN) / DEVIATION
    return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], np.float32)


def _read_checkpoint(path: Path, torch: Any, transformers: Any) -> Any:
    """The model of a checkpoint of Meta's; only tensors are read from the file, never code."""
    stored = torch.load(str(path), map_location="cpu", weights_only=True)
    weights = convert_meta_to_transformers_weights(stored["model"], torch)
    model = transformers.Sam2Model(_config_from_checkpoint_shapes(weights, path, transformers))
    missing, unknown = model.load_state_dict(weights, strict=False)
    if missing or unknown:
        said = f"{len(missing)} weights missing, {len(unknown)} unknown: {', '.join([*missing, *unknown][:3])}"
        remedy = "name a checkpoint as Meta publishes it"
        raise InputError(f"segment.model = {str(path)!r} is no whole SAM 2: {said}", remedy)
    return model.eval()


def convert_meta_to_transformers_weights(stored: Mapping[str, Any], torch: Any) -> dict[str, Any]:
    """The weights by their names in transformers, without the video tracker."""
    weights: dict[str, Any] = {}
    for name, value in stored.items():
        if name.startswith(TRACKING):
            continue
        renamed = name
        for pattern, other in RENAMED:
            renamed = re.sub(pattern, other, renamed)
        if any(head in renamed for head in HEADS):
            renamed = re.sub(r"\.layers\.(\d)\.", lambda layer: f".{HEAD_LAYERS[layer[1]]}.", renamed)
        weights[renamed] = value
    points = [weights.pop(f"prompt_encoder.point_embeddings.{number}.weight") for number in range(4)]
    weights["prompt_encoder.point_embed.weight"] = torch.cat(points)
    shared = weights["prompt_encoder.shared_embedding.positional_embedding"]
    weights["shared_image_embedding.positional_embedding"] = shared
    return weights


def _config_from_checkpoint_shapes(weights: Mapping[str, Any], path: Path, transformers: Any) -> Any:
    """Infer the configuration from the tensor shapes and the number of blocks of a checkpoint."""
    backbone = "vision_encoder.backbone"
    blocks = sum(name.startswith(f"{backbone}.blocks.") and name.endswith(".attn.qkv.weight") for name in weights)
    if blocks not in SIZES:
        raise InputError(
            f"segment.model = {str(path)!r} has {blocks} blocks", f"name one of {', '.join(map(str, SIZES))}"
        )
    size, width = SIZES[blocks], int(weights[f"{backbone}.patch_embed.projection.bias"].shape[0])
    widths = [width * 2**stage for stage in range(4)]
    heads = max(width // 56, 1)  # tiny and small: 96 wide, one head; base plus and large: 112 and 144, two
    hiera = transformers.Sam2HieraDetConfig(
        hidden_size=width,
        num_attention_heads=heads,
        blocks_per_stage=list(size.stages),
        embed_dim_per_stage=widths,
        num_attention_heads_per_stage=[heads * 2**stage for stage in range(4)],
        window_size_per_stage=list(size.windows),
        window_positional_embedding_background_size=list(weights[f"{backbone}.pos_embed"].shape[2:]),
        global_attention_blocks=list(size.attends_all),
    )
    vision = transformers.Sam2VisionConfig(backbone_config=hiera, backbone_channel_list=widths[::-1])
    return transformers.Sam2Config(vision_config=vision)


def _load_onnx_encoder_and_decoder(folder: Path, device: str) -> Embed:
    """The encoder and decoder of a folder, with the input and output names of the usual exporters."""
    try:
        runtime = importlib.import_module("onnxruntime")
    except ImportError as error:
        raise ConfigError("a SAM 2 in ONNX needs onnxruntime", 'pip install "grs-agents[onnx]"') from error
    provider = f"{device.partition(':')[0].upper()}ExecutionProvider"
    if provider not in runtime.get_available_providers():
        known = ", ".join(runtime.get_available_providers())
        raise ConfigError(f"segment.device = {device!r}: onnxruntime has only {known}", "use segment.device=cpu")
    encoder, decoder = (
        runtime.InferenceSession(str(_find_single_onnx_file(folder, part)), providers=[provider])
        for part in ("encoder", "decoder")
    )
    image = encoder.get_inputs()[0]
    side = int(image.shape[-1]) if isinstance(image.shape[-1], int) else 1024
    wanted = {entry.name: entry for entry in decoder.get_inputs()}

    def embed(rgb: Image) -> AskAtPoints:
        answers = encoder.run(None, {image.name: _normalize_photo(rgb, side)})
        embeddings = dict(zip((entry.name for entry in encoder.get_outputs()), answers, strict=True))

        def ask(points: Floats) -> tuple[Floats, Floats]:
            given = {**embeddings, **_decoder_inputs_for_points(points * side, side, wanted)}
            lacking = sorted(set(wanted) - set(given))
            if lacking:
                raise InputError(f"the decoder asks for {', '.join(lacking)}", "export it with the usual names")
            found = decoder.run(None, {name: given[name] for name in wanted})
            named = dict(zip((entry.name for entry in decoder.get_outputs()), found, strict=True))
            masks = _find_decoder_output(named, ("low_res_masks", "pred_masks", "masks"))
            scores = _find_decoder_output(named, ("iou_predictions", "iou_scores")).reshape(len(points), -1)
            return masks.reshape(len(points), scores.shape[1], *masks.shape[-2:]), scores

        return ask

    return embed


def _find_single_onnx_file(folder: Path, part: str) -> Path:
    """The encoder or the decoder of a folder; a decoder may include the prompt encoder."""
    named = [path for path in sorted(folder.glob("*.onnx")) if ("decoder" in path.stem) == (part == "decoder")]
    files = [path for path in named if part in path.stem]
    if len(files) != 1:
        raise ConfigError(f"segment.model = {str(folder)!r} has {len(files)} files *{part}*.onnx", "let it hold one")
    return files[0]


def _decoder_inputs_for_points(points: Floats, side: int, wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Decoder inputs for prompts in pixels, under the names of both ways of export."""
    count = len(points)
    points, labels = _label_prompts(points)
    flags = wanted["has_mask_input"].shape[0] if "has_mask_input" in wanted else 1
    return {
        "point_coords": points.astype(np.float32),
        "point_labels": labels.astype(np.float32),
        "mask_input": np.zeros((count, 1, side // 4, side // 4), np.float32),
        "has_mask_input": np.zeros(1 if flags == 1 else count, np.float32),
        "orig_im_size": np.array([side, side], np.int32),
        "input_points": points[None].astype(np.float32),
        "input_labels": labels[None],
        "input_boxes": np.zeros((1, 0, 4), np.float32),
    }


def _find_decoder_output(answers: Mapping[str, Floats], names: Sequence[str]) -> Floats:
    for name in names:
        if name in answers:
            return answers[name]
    raise InputError(f"the decoder answers with {', '.join(answers)}", f"export it with one of {', '.join(names)}")
