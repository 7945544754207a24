"""Checkpoints of LeRobot under evaluation: a real one where LeRobot is installed, refusals everywhere."""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.errors import InputError
from grs_agents.tasks.suites.evaluation import evaluate, make_order, read_results
from grs_agents.tasks.suites.layouts import PRESETS, Layout
from tests.needs import needs

STATE, OBJECTS, FRONT = "observation.state", "observation.environment_state", "observation.images.front"
SHAPES = {STATE: ("STATE", [21]), OBJECTS: ("ENV", [16]), FRONT: ("VISUAL", [3, 32, 48])}
"""Of a UR5e with suction and a single object."""


def write_config(folder: Path, shapes: dict[str, tuple[str, list[int]]] | None = None) -> str:
    """A checkpoint without weights; returns the policy's name."""
    features = {name: {"type": kind, "shape": shape} for name, (kind, shape) in (shapes or SHAPES).items()}
    config = {
        "type": "act",
        "input_features": features,
        "output_features": {"action": {"type": "ACTION", "shape": [7]}},
    }
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps(config))
    return f"lerobot:{folder}"


def judge(suite_folder: Path, out: Path, policy: str, layout: Layout = PRESETS["lerobot"]) -> list[Any]:
    """Evaluate one episode in this process."""
    order = make_order(suite_folder, policy, layout, episodes=1, tasks=("put-block-left",))
    evaluate(suite_folder, order, out, workers=1)
    return read_results(out)


def test_the_layout_takes_the_observations_and_the_size_of_the_checkpoint(suite_folder: Path, tmp_path: Path) -> None:
    policy = write_config(tmp_path / "policy")
    layout = make_order(suite_folder, policy, PRESETS["lerobot"]).layout
    assert (set(layout.observation), layout.cameras, layout.image_size) == ({*SHAPES, "task"}, ("front",), (32, 48))


def test_observations_that_the_layout_lacks_are_named(suite_folder: Path, tmp_path: Path) -> None:
    policy = write_config(tmp_path / "policy", {**SHAPES, "observation.images.top": ("VISUAL", [3, 32, 48])})
    with pytest.raises(InputError, match=r"observes observation\.images\.top; the layout has observation\.state, "):
        make_order(suite_folder, policy, PRESETS["lerobot"])
    with pytest.raises(InputError, match=r"observation\.state, .*; choose --layout lerobot"):
        make_order(suite_folder, policy, PRESETS["grs"])
    words = Layout(observation={**PRESETS["lerobot"].observation, STATE: "instruction"})
    with pytest.raises(InputError, match=r"observes observation\.state; "):
        make_order(suite_folder, write_config(tmp_path / "other"), words)


def test_pictures_of_two_sizes_are_refused(suite_folder: Path, tmp_path: Path) -> None:
    shapes = {**SHAPES, "observation.images.wrist": ("VISUAL", [3, 64, 64])}
    with pytest.raises(InputError, match=r"\[\(32, 48\), \(64, 64\)\]"):
        make_order(suite_folder, write_config(tmp_path / "policy", shapes), PRESETS["lerobot"])


def test_a_folder_without_a_checkpoint_is_refused(suite_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name the folder pretrained_model"):
        judge(suite_folder, tmp_path / "out", f"lerobot:{tmp_path}")
    policy = write_config(tmp_path / "policy")
    with pytest.raises(InputError, match=r"has no model\.safetensors"):
        judge(suite_folder, tmp_path / "out", policy)


def test_without_lerobot_its_installation_is_named(
    suite_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = write_config(tmp_path / "policy")
    (tmp_path / "policy" / "model.safetensors").touch()
    for package in ("lerobot", "lerobot.configs.policies", "lerobot.policies.factory"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=r"needs LeRobot: .*; run: pip install lerobot"):
        judge(suite_folder, tmp_path / "out", policy)
    assert not (tmp_path / "out").exists()


def test_classes_that_a_processor_names_are_not_imported(suite_folder: Path, tmp_path: Path) -> None:
    policy = write_config(tmp_path / "policy")
    (tmp_path / "policy" / "model.safetensors").touch()
    steps = [{"class": "subprocess.Popen", "config": {"args": ["touch", str(tmp_path / "run")]}}]
    (tmp_path / "policy" / "policy_preprocessor.json").write_text(json.dumps({"name": "x", "steps": steps}))
    with pytest.raises(InputError, match="not registered in LeRobot"):
        judge(suite_folder, tmp_path / "out", policy)
    assert not (tmp_path / "run").exists()


def write_checkpoint(folder: Path, shapes: dict[str, tuple[str, list[int]]], columns: int = 7) -> str:
    """A tiny ACT as LeRobot saves it, untrained; returns the policy's name."""
    types: Any = import_module("lerobot.configs.types")
    act: Any = import_module("lerobot.policies.act.configuration_act")
    modeling: Any = import_module("lerobot.policies.act.modeling_act")
    factory: Any = import_module("lerobot.policies.factory")
    torch: Any = import_module("torch")
    features = {
        name: types.PolicyFeature(types.FeatureType[kind], tuple(shape)) for name, (kind, shape) in shapes.items()
    }
    action = {"action": types.PolicyFeature(types.FeatureType.ACTION, (columns,))}
    config = act.ACTConfig(
        input_features=features,
        output_features=action,
        device="cpu",
        chunk_size=20,
        n_action_steps=20,
        dim_model=16,
        dim_feedforward=16,
        n_heads=2,
        n_encoder_layers=1,
        n_vae_encoder_layers=1,
        pretrained_backbone_weights=None,
    )
    stats = {
        name: {kind: torch.full((3, 1, 1) if name == FRONT else feature.shape, 0.5) for kind in ("mean", "std")}
        for name, feature in {**features, **action}.items()
    }
    torch.manual_seed(0)
    if hasattr(factory, "make_pre_post_processors"):
        modeling.ACTPolicy(config).save_pretrained(folder)
        for processor in factory.make_pre_post_processors(config, dataset_stats=stats):
            processor.save_pretrained(folder)
    else:  # LeRobot 0.3 keeps the statistics among the weights
        modeling.ACTPolicy(config, dataset_stats=stats).save_pretrained(folder)
    return f"lerobot:{folder}"


@needs("lerobot", "torch")
def test_a_checkpoint_of_lerobot_acts(suite_folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    policy = write_checkpoint(tmp_path / "policy", SHAPES)
    (row,) = judge(suite_folder, tmp_path / "out", policy)
    assert (row.outcome, row.detail) == ("horizon", "") and row.path > 0.1
    assert judge(suite_folder, tmp_path / "again", policy) == [row]
    assert capfd.readouterr().out == ""  # which is for --json
    (tmp_path / "policy" / "model.safetensors").write_bytes(b"\x80\x04K\x01.")  # a pickle
    with pytest.raises(InputError, match="LeRobot cannot load"):
        judge(suite_folder, tmp_path / "broken", policy)


@needs("lerobot", "torch")
def test_a_failure_of_the_policy_is_an_outcome(
    suite_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("out of memory")

    monkeypatch.setattr(import_module("lerobot.policies.act.modeling_act").ACTPolicy, "select_action", fail)
    policy = write_checkpoint(tmp_path / "policy", {OBJECTS: SHAPES[OBJECTS]})
    (row,) = judge(suite_folder, tmp_path / "out", policy)
    assert (row.outcome, row.detail) == ("policy_error", "RuntimeError: out of memory")


@needs("lerobot", "torch")
@pytest.mark.parametrize(
    ("objects", "columns", "named"),
    [
        (32, 7, r"environment_state of the policy .* has the shape \(32,\), the task's \(16,\)"),
        (16, 5, r"actions of the policy .* have the shape \(5,\), those of the task \(7,\)"),
    ],
)
def test_other_shapes_than_the_task_has_are_refused(
    suite_folder: Path, tmp_path: Path, objects: int, columns: int, named: str
) -> None:
    policy = write_checkpoint(tmp_path / "policy", {OBJECTS: ("ENV", [objects])}, columns)
    with pytest.raises(InputError, match=named):
        judge(suite_folder, tmp_path / "out", policy)
