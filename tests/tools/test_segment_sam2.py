"""Segmentation by a SAM 2 of the user's own: what is refused without it, and a tiny real one where transformers is."""

import contextlib
import importlib
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.perception.table_finding import find_table
from grs_agents.toolkit import ToolContext
from tests.needs import needs, require
from tests.perception.conftest import THINGS, render
from tests.perception.segmentation.test_sam2_models import write_color_segmenter

FRAME = render(THINGS, calibrated=True).frame
TABLE = find_table(FRAME, np.random.default_rng(0))


def ask(model: str | None, context: ToolContext, **options: Any) -> Any:
    tool = content.load_module("tools", "segment_sam2")
    return tool.run(tool.Request(frame=FRAME, table=TABLE, model=model, **options), context)


def installed(monkeypatch: pytest.MonkeyPatch, **matchable_assets: Any) -> None:
    """A stand-in for transformers."""
    quiet = SimpleNamespace(set_verbosity_error=lambda: None, disable_progress_bar=lambda: None)
    torch, transformers = ModuleType("torch"), ModuleType("transformers")
    vars(torch).update(inference_mode=contextlib.nullcontext)
    vars(transformers).update(logging=quiet, **matchable_assets)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "transformers", transformers)


def folder_of(folder: Path, kind: str = "sam2") -> str:
    (folder / "config.json").write_text(json.dumps({"model_type": kind}))
    return str(folder)


def test_a_model_without_all_its_weights_is_refused_by_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    loaded: list[dict[str, Any]] = []

    def from_pretrained(folder: str, **options: Any) -> Any:
        loaded.append(options)
        return None, {"missing_keys": {"b.weight", "a.weight", "c.bias", "d.bias"}}

    installed(monkeypatch, Sam2Model=SimpleNamespace(from_pretrained=from_pretrained))
    with pytest.raises(InputError, match=r"lacks 4 of its weights: a\.weight, b\.weight, c\.bias, \.\.\.;"):
        ask(folder_of(tmp_path), context)
    assert loaded[0]["local_files_only"]
    assert loaded[0]["use_safetensors"]
    assert not loaded[0].get("trust_remote_code")


def test_what_the_model_stumbles_over_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    def from_pretrained(folder: str, **options: Any) -> Any:
        raise OSError("no file named model.safetensors\nand much more")

    installed(monkeypatch, Sam2Model=SimpleNamespace(from_pretrained=from_pretrained))
    with pytest.raises(InputError, match=r"failed on .*: no file named model\.safetensors; "):
        ask(folder_of(tmp_path, "sam2_video"), context)


@pytest.mark.parametrize("missing", ["torch", "Sam2Model"])
def test_without_transformers_or_of_an_old_one_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext, missing: str
) -> None:
    installed(monkeypatch)
    if missing == "torch":
        monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ConfigError, match=r"4\.56.*grs-agents\[sam2\]"):
        ask(folder_of(tmp_path), context)


def test_a_model_of_another_kind_is_refused(tmp_path: Path, context: ToolContext) -> None:
    with pytest.raises(ConfigError, match=r"is a bert model.*sam2"):
        ask(folder_of(tmp_path, "bert"), context)


@pytest.mark.parametrize("text", ["", "[]", "3", "{}", '{"model_type":', "[" * 20_000], ids=lambda value: value[:9])
def test_a_folder_that_holds_no_model_is_refused(tmp_path: Path, context: ToolContext, text: str) -> None:
    (tmp_path / "config.json").write_text(text)
    for name in (str(tmp_path), str(tmp_path / "nothing"), "some/model-on-a-hub"):
        with pytest.raises(ConfigError, match=r"segment\.model"):
            ask(name, context)
    with pytest.raises(ConfigError, match="needs a model"):
        ask(None, context)


def tiny(transformers: Any, sure: bool) -> Any:
    """A SAM 2 of a few ten thousand random weights for pictures of 128 x 128; ``sure`` of its masks, or not."""
    vision = transformers.Sam2VisionConfig(
        backbone_config=transformers.Sam2HieraDetConfig(
            hidden_size=8,
            image_size=[128, 128],
            blocks_per_stage=[1, 1, 2, 1],
            embed_dim_per_stage=[8, 16, 24, 32],
            num_attention_heads_per_stage=[1, 1, 1, 1],
            window_size_per_stage=[8, 4, 4, 2],
            global_attention_blocks=[3],
        ),
        backbone_channel_list=[32, 24, 16, 8],
        backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
        fpn_hidden_size=16,
    )
    prompt = transformers.Sam2PromptEncoderConfig(hidden_size=16, image_size=128, patch_size=16)
    decoder = transformers.Sam2MaskDecoderConfig(
        hidden_size=16, mlp_dim=16, num_attention_heads=2, iou_head_hidden_dim=8
    )
    config = transformers.Sam2Config(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    model = transformers.Sam2Model(config)
    for name, weights in model.named_parameters():
        if name.startswith("mask_decoder.iou_prediction_head.proj_out"):
            weights.data.fill_(10.0 if sure and name.endswith("bias") else 0.0)
        if "output_hypernetworks_mlps" in name:
            weights.data *= 40.0  # far from the threshold, so stable
    return model


@pytest.fixture
def real() -> Any:
    require("torch", "transformers")
    torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
    torch.manual_seed(0)
    return transformers


def test_a_real_model_is_loaded_and_asked_and_its_cost_is_told(tmp_path: Path, real: Any, context: ToolContext) -> None:
    tiny(real, sure=True).save_pretrained(tmp_path)
    told: list[str] = []
    listening = replace(context, say=told.append)
    one, other = (ask(str(tmp_path), listening, batch=batch).candidates for batch in (16, 5))
    assert len(one) == len(other) > 0
    assert all((left.mask == right.mask).mean() > 0.999 for left, right in zip(one, other, strict=True))
    assert re.fullmatch(r"asks SAM 2 at \d+ points, which takes 75 to 170 CPU seconds a photo", told[0])


def test_what_the_model_is_not_sure_of_is_segmented_by_depth_alone(
    tmp_path: Path, real: Any, context: ToolContext
) -> None:
    tiny(real, sure=False).save_pretrained(tmp_path)
    found = ask(str(tmp_path), context).candidates
    by_depth = content.load_module("tools", "segment_rgbd")
    expected = by_depth.run(by_depth.Request(frame=FRAME, table=TABLE), context).candidates
    assert len(found) == len(expected) == len(THINGS)
    assert all((one.mask == other.mask).all() for one, other in zip(found, expected, strict=True))


@needs("onnx", "onnxruntime")
def test_a_model_in_onnx_finds_what_is_of_one_colour(tmp_path: Path, context: ToolContext) -> None:
    write_color_segmenter(tmp_path)
    assert len(ask(str(tmp_path), context).candidates) == len(THINGS)


def test_a_torn_model_is_refused(tmp_path: Path, real: Any, context: ToolContext) -> None:
    tiny(real, sure=True).save_pretrained(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"torn")
    with pytest.raises(InputError, match="failed on"):
        ask(str(tmp_path), context)
    (tmp_path / "model.safetensors").unlink()
    (tmp_path / "pytorch_model.bin").write_bytes(b"pickle")
    with pytest.raises(InputError, match="failed on"):
        ask(str(tmp_path), context)
    weights = {name: value for name, value in tiny(real, sure=True).state_dict().items() if "conv_s0" not in name}
    real.Sam2Model(tiny(real, sure=True).config).save_pretrained(tmp_path, state_dict=weights)
    with pytest.raises(InputError, match=r"lacks 2 of its weights: mask_decoder\.conv_s0\.bias"):
        ask(str(tmp_path), context)
