"""Depth by a model of the user's own: a stand-in for transformers, and the real one where it is installed."""

import contextlib
import importlib
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.toolkit import ToolContext
from tests.needs import needs

RGB = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)


class Tensor:
    """As much of a tensor as the tool touches."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def to(self, dtype: Any) -> "Tensor":
        return Tensor(self.values.astype(dtype))

    def numpy(self) -> Any:
        return self.values

    def __float__(self) -> float:
        return float(self.values)


class StandIn:
    """Both processor and model: sees a plane 0.8 m away, and remembers how it was loaded and asked."""

    def __init__(self, kind: str, missing: tuple[str, ...] = (), focal: float | None = None, error: str = "") -> None:
        self.config = SimpleNamespace(model_type=kind)
        self.missing, self.focal, self.error = missing, focal, error
        self.loaded: list[dict[str, Any]] = []
        self.post: dict[str, Any] = {}

    def from_pretrained(self, folder: str, output_loading_info: bool = False, **options: Any) -> Any:
        self.loaded.append(options)
        return (self, {"missing_keys": set(self.missing)}) if output_loading_info else self

    def eval(self) -> "StandIn":
        return self

    def __call__(self, images: Any = None, return_tensors: str = "", pixels: Any = None) -> Any:
        if self.error:
            raise RuntimeError(self.error)
        return {"pixels": images} if return_tensors else pixels

    def post_process_depth_estimation(self, outputs: Any, **sizes: Any) -> list[dict[str, Any]]:
        self.post = sizes
        rows, columns = sizes["target_sizes"][0]
        focal = {} if self.focal is None else {"focal_length": Tensor(self.focal)}
        return [{"predicted_depth": Tensor(np.full((rows, columns), 0.8)), **focal}]


def installed(monkeypatch: pytest.MonkeyPatch, model: StandIn) -> StandIn:
    torch, transformers = ModuleType("torch"), ModuleType("transformers")
    vars(torch).update(inference_mode=contextlib.nullcontext, float32=np.float32)
    quiet = SimpleNamespace(set_verbosity_error=lambda: None, disable_progress_bar=lambda: None)
    vars(transformers).update(AutoImageProcessor=model, AutoModelForDepthEstimation=model, logging=quiet)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "transformers", transformers)
    return model


def folder_of(folder: Path, **config: Any) -> str:
    (folder / "config.json").write_text(json.dumps(config))
    return str(folder)


def ask(model: str | None, context: ToolContext) -> Any:
    tool = content.load_module("tools", "depth_transformers")
    return tool.run(tool.Request(rgb=RGB, focal=None, photo="table.jpg", model=model), context)


@pytest.mark.parametrize(
    "config",
    [{"model_type": "zoedepth"}, {"model_type": "depth_anything", "depth_estimation_type": "metric"}],
    ids=lambda value: value["model_type"],
)
def test_a_metric_model_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext, config: dict[str, Any]
) -> None:
    model = installed(monkeypatch, StandIn(config["model_type"], focal=500.0))
    found = ask(folder_of(tmp_path, **config), context)
    assert found.depth.dtype == np.float32 and found.depth.shape == (40, 60)
    assert found.focal == 500.0
    assert ("source_sizes" in model.post) == (config["model_type"] == "zoedepth")


def test_nothing_is_downloaded_and_no_code_of_the_model_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    model = installed(monkeypatch, StandIn("glpn"))
    assert ask(folder_of(tmp_path, model_type="glpn"), context).focal is None
    assert all(one["local_files_only"] and not one["trust_remote_code"] for one in model.loaded)
    assert model.loaded[1]["use_safetensors"]


@pytest.mark.parametrize("focal", [float("nan"), float("inf")])
def test_a_focal_length_that_is_none_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext, focal: float
) -> None:
    installed(monkeypatch, StandIn("depth_pro", focal=focal))
    assert ask(folder_of(tmp_path, model_type="depth_pro"), context).focal is None


def test_a_model_without_all_its_weights_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    installed(monkeypatch, StandIn("glpn", missing=("head.weight", "head.bias")))
    with pytest.raises(InputError, match="lacks 2 of its weights"):
        ask(folder_of(tmp_path, model_type="glpn"), context)


def test_what_the_model_stumbles_over_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    installed(monkeypatch, StandIn("glpn", error="shapes differ\nand much more"))
    with pytest.raises(InputError, match=r"failed on table\.jpg: shapes differ; "):
        ask(folder_of(tmp_path, model_type="glpn"), context)


def test_without_transformers_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, context: ToolContext
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ConfigError, match=r"grs-agents\[transformers\]"):
        ask(folder_of(tmp_path, model_type="glpn"), context)


@pytest.mark.parametrize(
    "config", [{"model_type": "bert"}, {"model_type": "depth_anything", "depth_estimation_type": "relative"}], ids=str
)
def test_a_model_that_does_not_answer_in_metres_is_refused(
    tmp_path: Path, context: ToolContext, config: dict[str, Any]
) -> None:
    with pytest.raises(ConfigError, match=r"not in metres.*zoedepth"):
        ask(folder_of(tmp_path, **config), context)


@pytest.mark.parametrize("text", ["", "[]", "3", "{}", '{"model_type":', "[" * 20_000], ids=lambda value: value[:9])
def test_a_folder_that_holds_no_model_is_refused(tmp_path: Path, context: ToolContext, text: str) -> None:
    (tmp_path / "config.json").write_text(text)
    for name in (str(tmp_path), str(tmp_path / "nothing"), "some/model-on-a-hub"):
        with pytest.raises(ConfigError, match=r"depth\.model"):
            ask(name, context)
    with pytest.raises(ConfigError, match="needs a model"):
        ask(None, context)


@needs("torch", "transformers")
def test_a_real_model_is_loaded_and_asked(tmp_path: Path, context: ToolContext) -> None:
    """A Depth Anything of a few thousand random weights."""
    transformers = importlib.import_module("transformers")
    stages = ["stage1", "stage2", "stage3", "stage4"]
    backbone = transformers.Dinov2Config(
        image_size=56,
        patch_size=14,
        num_hidden_layers=4,
        hidden_size=16,
        num_attention_heads=2,
        out_features=stages,
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        neck_hidden_sizes=[4, 8, 8, 8],
        fusion_hidden_size=8,
        head_hidden_size=4,
        depth_estimation_type="metric",
        max_depth=2,
    )
    transformers.DepthAnythingForDepthEstimation(config).save_pretrained(tmp_path)
    size = {"height": 56, "width": 56}
    transformers.DPTImageProcessor(size=size, keep_aspect_ratio=True, ensure_multiple_of=14).save_pretrained(tmp_path)
    found = ask(str(tmp_path), context)
    assert found.depth.shape == (40, 60)
    assert 0 < found.depth.min() <= found.depth.max() <= 2
    (tmp_path / "model.safetensors").write_bytes(b"torn")
    with pytest.raises(InputError, match="failed on"):
        ask(str(tmp_path), context)
