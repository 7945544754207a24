"""Checkpoints of LeRobot policies: the folder ``pretrained_model`` that ``lerobot-train`` writes.

Read are ``config.json``, ``model.safetensors`` and, since LeRobot 0.4, the pre- and postprocessor. Nothing is
unpickled, and no class is imported that a file names: processors consist of LeRobot's registered steps. Backbones are
not downloaded; tokenizers of language models may be, by LeRobot, unless ``HF_HUB_OFFLINE`` is set.
"""

import sys
from collections.abc import Iterable
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, ValidationError

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_json
from grs_agents.tasks.suites.layouts import CAMERA, INSTRUCTION, Layout, Observation

_ACTION: Final = "action"
_PROCESSORS: Final = ("policy_preprocessor.json", "policy_postprocessor.json")
_DEVICE: Final = "device_processor"
"""Registered name of the step that moves tensors to the device of the training."""
_REMEDY: Final = "name the folder pretrained_model that lerobot-train wrote"


class _Feature(BaseModel):
    model_config = ConfigDict(frozen=True)

    type: str  # VISUAL, STATE, ENV or ACTION
    shape: tuple[int, ...]  # of pictures (3, H, W)


class _Config(BaseModel):
    """The fields of ``config.json`` that say what a policy observes and does."""

    model_config = ConfigDict(frozen=True)

    input_features: dict[str, _Feature]
    output_features: dict[str, _Feature]


def _read_config(folder: Path) -> _Config:
    """The features of a checkpoint. Raises InputError: the folder holds none."""
    file = folder / "config.json"
    try:
        return _Config.model_validate(read_json(file, _REMEDY))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{file}: {'.'.join(map(str, first['loc']))}: {first['msg']}", _REMEDY) from error


def fit_layout(folder: Path, layout: Layout) -> Layout:
    """The layout without observations that the policy does not take, and with pictures of the size that it takes.

    Raises:
        InputError: the folder holds no checkpoint, or the layout lacks observations of the policy.
    """
    inputs = _read_config(folder).input_features
    pictures = {name for name, source in layout.observation.items() if source.startswith(CAMERA)}
    visual = {name for name, feature in inputs.items() if feature.type == "VISUAL"}
    numbers = {name for name, source in layout.observation.items() if source != INSTRUCTION} - pictures
    if missing := [name for name in inputs if name not in (pictures if name in visual else numbers)]:
        known = _list(f"{name} (picture)" if name in pictures else name for name in layout.observation) or "nothing"
        raise InputError(
            f"the policy in {folder} observes {_list(missing)}; the layout has {known}",
            "choose --layout lerobot, or a TOML file with these names",
        )
    sizes = {inputs[name].shape[-2:] for name in visual}
    if len(sizes) > 1:
        raise InputError(
            f"the policy in {folder} observes pictures of the sizes {sorted(sizes)}", "train it with pictures of one"
        )
    kept = {name: source for name, source in layout.observation.items() if name in inputs or source == INSTRUCTION}
    fitted = {**layout.model_dump(), "observation": kept, **({"image_size": sizes.pop()} if sizes else {})}
    try:
        return Layout.model_validate(fitted)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"pictures of the policy in {folder}: {first['msg']}", "train it with others") from error


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)


class LerobotCheckpoint:
    """A policy of LeRobot, ready to act.

    Raises:
        InputError: LeRobot is not installed, or the folder holds no checkpoint that it loads.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._features = folder, _read_config(folder)
        if not (folder / "model.safetensors").is_file():
            raise InputError(f"{folder} has no model.safetensors", _REMEDY)
        names = [name for file in _PROCESSORS if (folder / file).exists() for name in _list_steps(folder / file)]
        try:
            self._torch: Any = import_module("torch")
            configs: Any = import_module("lerobot.configs.policies")
            factory: Any = import_module("lerobot.policies.factory")
        except ImportError as error:
            raise InputError(f"the policy needs LeRobot: {error}", "run: pip install lerobot") from error
        with redirect_stdout(sys.stderr):  # LeRobot prints what it loads
            try:
                config: Any = configs.PreTrainedConfig.from_pretrained(str(folder))
                if hasattr(config, "pretrained_backbone_weights"):
                    config.pretrained_backbone_weights = None  # would be downloaded; the checkpoint has its own
                kind: Any = factory.get_policy_class(config.type)
                self._policy: Any = kind.from_pretrained(str(folder), config=config, strict=True)
                self._before: Any = _keep
                self._after: Any = _keep
                if hasattr(factory, "make_pre_post_processors"):  # LeRobot 0.3 normalizes inside the policy
                    override = {_DEVICE: {"device": str(config.device)}} if _DEVICE in names else {}
                    self._before, self._after = factory.make_pre_post_processors(
                        config,
                        pretrained_path=str(folder),
                        preprocessor_overrides=override,
                    )
            except (Exception, SystemExit) as error:  # draccus exits where config.json has unknown fields
                raise InputError(
                    f"LeRobot cannot load {folder}: {type(error).__name__}: {str(error)[:500]}",
                    "use the version of LeRobot that wrote it, with the extra of the policy",
                ) from error
        self._device: Any = config.device

    def check_action(self, columns: int) -> None:
        """Raise InputError unless actions have so many columns."""
        width = self._features.output_features[_ACTION].shape if _ACTION in self._features.output_features else ()
        if width != (columns,):
            raise InputError(
                f"actions of the policy in {self._folder} have the shape {width}, those of the task ({columns},)",
                "choose a layout with the control of the policy's data, and a suite of its robot",
            )

    def reset(self, seed: int) -> None:
        """Begin an episode; ``seed`` is of the draws of a policy that samples."""
        self._torch.manual_seed(seed)
        self._policy.reset()

    def make_batch(self, observation: Observation, instruction: str) -> dict[str, Any]:
        """The observation as LeRobot's policies take it: tensors (1, ...), pictures (1, 3, H, W) within 0..1.

        Raises:
            InputError: its shapes are not those of the training.
        """
        batch: dict[str, Any] = {"task": [instruction]}
        for name, feature in self._features.input_features.items():
            value: npt.NDArray[Any] = observation[name]
            if feature.type == "VISUAL":
                value = np.moveaxis(value, -1, 0).astype(np.float32) / 255.0
            if value.shape != feature.shape:
                raise InputError(
                    f"{name} of the policy in {self._folder} has the shape {feature.shape}, the task's {value.shape}",
                    "evaluate on tasks with the robot and the number of objects of its data",
                )
            batch[name] = self._torch.from_numpy(np.ascontiguousarray(value))[None].to(self._device)
        return batch

    def act(self, batch: dict[str, Any]) -> npt.NDArray[np.float64]:
        """The next action (D,)."""
        with self._torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(batch)))
        return action[0].double().cpu().numpy()


def _keep(value: Any) -> Any:
    return value


def _list_steps(file: Path) -> list[str]:
    """Registered names of a processor's steps. Raises InputError: a step is a class to be imported."""
    steps = cast("list[Any]", read_json(file, _REMEDY).get("steps"))
    try:
        return [str(step["registry_name"]) for step in steps]
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{file} has steps that are not registered in LeRobot", "only registered steps are run: take the others out"
        ) from error
