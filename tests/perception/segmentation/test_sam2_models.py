"""A SAM 2 from disk: a checkpoint with Meta's names for the weights, and an encoder and decoder in ONNX."""

import importlib
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.base.errors import ConfigError, InputError
from grs_agents.perception.segmentation.sam2_models import (
    DEVIATION,
    MEAN,
    load_sam2,
    segment_rectangle_with_sam2,
)
from grs_agents.perception.types import Camera, Image, RGBDFrame
from tests.needs import needs

RGB: Image = np.random.default_rng(0).integers(0, 256, (60, 80, 3)).astype(np.uint8)
POINTS = np.array([[0.3, 0.4], [0.7, 0.2], [0.1, 0.9]], np.float32)
META = {
    r"^vision_encoder\.backbone\.": "image_encoder.trunk.",
    r"^vision_encoder\.neck\.convs\.(\d)\.": r"image_encoder.neck.convs.\1.conv.",
    r"^(prompt_encoder|mask_decoder)\.": r"sam_\1.",
    r"^no_memory_embedding$": "no_mem_embed",
    r"patch_embed\.projection": "patch_embed.proj",
    r"layer_norm(\d|_final_attn)\.": r"norm\1.",
    r"\.o_proj\.": ".out_proj.",
    r"(mlps\.\d|_head)\.proj_in": r"\1.layers:0",
    r"(mlps\.\d|_head)\.layers\.0": r"\1.layers:1",
    r"(mlps\.\d|_head)\.proj_out": r"\1.layers:2",
    r"mlp\.proj_in": "mlp.layers:0",
    r"mlp\.proj_out": "mlp.layers:1",
    r"layers:": "layers.",
    r"upscale_conv1": "output_upscaling.0",
    r"upscale_layer_norm": "output_upscaling.1",
    r"upscale_conv2": "output_upscaling.3",
    r"mask_embed\.conv1": "mask_downscaling.0",
    r"mask_embed\.norm1": "mask_downscaling.1",
    r"mask_embed\.conv2": "mask_downscaling.3",
    r"mask_embed\.norm2": "mask_downscaling.4",
    r"mask_embed\.conv3": "mask_downscaling.6",
    r"shared_embedding\.positional_embedding": "pe_layer.positional_encoding_gaussian_matrix",
}


def _meta_weights(model: Any) -> dict[str, Any]:
    """The model's weights by the names that Meta's checkpoints have for them, and one that only tracks."""
    weights: dict[str, Any] = {}
    for name, value in model.state_dict().items():
        renamed = name
        for pattern, other in META.items():
            renamed = re.sub(pattern, other, renamed)
        weights[renamed] = value
    points = weights.pop("sam_prompt_encoder.point_embed.weight")
    for number in range(4):
        weights[f"sam_prompt_encoder.point_embeddings.{number}.weight"] = points[number : number + 1]
    del weights["shared_image_embedding.positional_embedding"]
    return {**weights, "maskmem_tpos_enc": points}


@pytest.fixture
def narrow() -> Any:
    """A SAM 2 of the tiny size, but a twelfth as wide."""
    torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
    torch.manual_seed(0)
    widths = [8, 16, 32, 64]
    hiera = transformers.Sam2HieraDetConfig(hidden_size=8, embed_dim_per_stage=widths)
    vision = transformers.Sam2VisionConfig(backbone_config=hiera, backbone_channel_list=widths[::-1])
    model = transformers.Sam2Model(transformers.Sam2Config(vision_config=vision))
    for weights in model.parameters():
        weights.data += 0.02 * torch.randn_like(weights)
    shared = model.prompt_encoder.shared_embedding.positional_embedding
    model.shared_image_embedding.positional_embedding.data.copy_(shared)
    return model


@needs("torch", "transformers")
def test_a_checkpoint_of_metas_answers_as_the_same_model_of_transformers(tmp_path: Path, narrow: Any) -> None:
    torch = importlib.import_module("torch")
    narrow.save_pretrained(tmp_path / "folder")
    torch.save({"model": _meta_weights(narrow)}, tmp_path / "meta.pt")
    (one, scores), (other, others) = (
        load_sam2(str(tmp_path / name), "cpu")(RGB)(POINTS) for name in ("folder", "meta.pt")
    )
    assert one.shape == (3, 3, 256, 256)
    assert np.ptp(one) > 0.1
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(scores, others)


@needs("torch", "transformers")
def test_a_box_is_a_prompt_as_transformers_takes_it(tmp_path: Path, narrow: Any) -> None:
    torch = importlib.import_module("torch")
    narrow.save_pretrained(tmp_path)
    camera = Camera(fx=80, fy=80, cx=40, cy=30, width=80, height=60, depth_scale=1)
    frame = RGBDFrame(RGB, np.zeros((60, 80), np.float32), camera, tmp_path)
    window = np.s_[12:45, 16:56]
    mask = segment_rectangle_with_sam2(frame, window, str(tmp_path), "cpu")
    assert mask is not None and mask.shape == (60, 80) and mask.any()
    assert not mask[:12].any() and not mask[:, 56:].any()
    again = segment_rectangle_with_sam2(frame, window, str(tmp_path), "cpu")
    assert again is not None and (mask == again).all()
    box = np.array([[[16 / 80, 12 / 60], [56 / 80, 45 / 60]]], np.float32)
    logits, scores = load_sam2(str(tmp_path), "cpu")(RGB)(box)
    picture = ((cv2.resize(RGB, (1024, 1024)) / 255 - MEAN) / DEVIATION).transpose(2, 0, 1)[None]
    corners = torch.tensor([[[16 / 80, 12 / 60, 56 / 80, 45 / 60]]]) * 1024
    with torch.inference_mode():
        answer = narrow.eval()(pixel_values=torch.tensor(picture, dtype=torch.float32), input_boxes=corners)
    np.testing.assert_allclose(scores, answer.iou_scores[0], atol=1e-4)
    np.testing.assert_allclose(logits, answer.pred_masks[0], atol=1e-3)


@needs("torch", "transformers")
def test_a_checkpoint_that_is_not_whole_or_no_sam_2_is_refused(tmp_path: Path, narrow: Any) -> None:
    torch = importlib.import_module("torch")
    weights = _meta_weights(narrow)
    lacking = {name: value for name, value in weights.items() if "conv_s0" not in name}
    torch.save({"model": lacking}, tmp_path / "lacking.pt")
    with pytest.raises(InputError, match=r"2 weights missing, 0 unknown: mask_decoder\.conv_s0"):
        load_sam2(str(tmp_path / "lacking.pt"), "cpu")
    fewer = {name: value for name, value in weights.items() if "blocks.11." not in name}
    torch.save({"model": fewer}, tmp_path / "fewer.pt")
    with pytest.raises(InputError, match="has 11 blocks"):
        load_sam2(str(tmp_path / "fewer.pt"), "cpu")


def test_what_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        load_sam2(str(tmp_path / "none.pt"), "cpu")


def write_color_segmenter(folder: Path, prompts: int | str = "n") -> None:
    """An encoder and a decoder in ONNX whose mask of a point is what has nearly its colour; pictures of 256 x 256."""
    onnx = importlib.import_module("onnx")
    make, kind = onnx.helper, onnx.TensorProto
    side, fine = 256, 64

    def info(name: str, *shape: int | str, type_: int = kind.FLOAT) -> Any:
        return make.make_tensor_value_info(name, type_, shape)

    def write(name: str, nodes: list[Any], given: list[Any], answers: list[Any], **constants: Any) -> None:
        values = [onnx.numpy_helper.from_array(np.asarray(value), key) for key, value in constants.items()]
        graph = make.make_graph(nodes, name, given, answers, values)
        model = make.make_model(graph, opset_imports=[make.make_opsetid("", 18)], ir_version=9)
        onnx.checker.check_model(model)
        onnx.save(model, str(folder / f"sam2.{name}.onnx"))

    node = make.make_node
    embedding = info("image_embed", 1, 3, fine, fine)
    write(
        "encoder",
        [node("AveragePool", ["image"], ["image_embed"], kernel_shape=[4, 4], strides=[4, 4])],
        [info("image", 1, 3, side, side)],
        [embedding],
    )
    write(
        "decoder",
        [
            node("Mul", ["point_coords", "scale"], ["scaled"]),
            node("Sub", ["scaled", "one"], ["centered"]),
            node("Transpose", ["centered"], ["grid"], perm=[1, 0, 2]),
            node("Unsqueeze", ["grid", "zero"], ["grids"]),
            node("Reshape", ["grids", "grid_shape"], ["lookup"]),
            node("GridSample", ["image_embed", "lookup"], ["sampled"], mode="nearest"),
            node("Transpose", ["sampled"], ["colors"], perm=[3, 1, 0, 2]),
            node("Sub", ["image_embed", "colors"], ["apart"]),
            node("Abs", ["apart"], ["distance"]),
            node("ReduceSum", ["distance", "axis"], ["far"], keepdims=1),
            node("Sub", ["near", "far"], ["close"]),
            node("Mul", ["close", "steep"], ["masks"]),
            node("Mul", ["point_labels", "sure"], ["iou_predictions"]),
        ],
        [
            embedding,
            info("point_coords", prompts, 1, 2),
            info("point_labels", prompts, 1),
            info("mask_input", prompts, 1, fine, fine),
            info("has_mask_input", 1),
        ],
        [info("masks", prompts, 1, fine, fine), info("iou_predictions", prompts, 1)],
        scale=np.float32(2 / side),
        one=np.float32(1),
        zero=np.array([0], np.int64),
        grid_shape=np.array([1, 1, -1, 2], np.int64),
        axis=np.array([1], np.int64),
        near=np.float32(0.4),
        steep=np.float32(100),
        sure=np.float32(0.9),
    )


@needs("onnx", "onnxruntime")
def test_an_encoder_and_a_decoder_in_onnx_are_asked(tmp_path: Path) -> None:
    write_color_segmenter(tmp_path)
    rgb = np.zeros((60, 80, 3), np.uint8)
    rgb[:, 40:] = (200, 30, 30)
    masks, scores = load_sam2(str(tmp_path), "cpu")(rgb)(np.array([[0.9, 0.5], [0.1, 0.5]], np.float32))
    assert masks.shape == (2, 1, 64, 64)
    assert scores == pytest.approx(0.9, abs=1e-4)
    assert (masks[0, 0, :, 34:] > 0).all()
    assert (masks[0, 0, :, :30] < 0).all()
    assert (masks[1, 0, :, :30] > 0).all()


@needs("onnx", "onnxruntime")
def test_a_folder_of_onnx_without_a_decoder_and_a_device_that_is_not_there_are_refused(tmp_path: Path) -> None:
    write_color_segmenter(tmp_path)
    with pytest.raises(ConfigError, match=r"onnxruntime has only .*CPUExecutionProvider"):
        load_sam2(str(tmp_path), "abacus")
    (tmp_path / "sam2.decoder.onnx").unlink()
    with pytest.raises(ConfigError, match=r"0 files \*decoder\*\.onnx"):
        load_sam2(str(tmp_path), "cpu")
