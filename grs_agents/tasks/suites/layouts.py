"""Layouts: how a policy names observations, and how its actions are read.

A preset has a name; a layout of one's own is a TOML file with the same fields::

    control = "joint_velocity"
    execute = 8
    image_size = [224, 224]

    [observation]
    "observation/exterior_image_1_left" = "camera:front"
    "observation/joint_position" = "joint_positions"
    "prompt" = "instruction"

    [action]
    key = "actions"
    gripper = "positive"
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, cast

import numpy as np
import numpy.typing as npt
from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.foreign.files import read_text
from grs_agents.tasks.envs.controls import ControlName
from grs_agents.tasks.envs.state import AGENT_STATE, TASK_STATE

Observation = dict[str, Any]
CAMERA, INSTRUCTION, CLOSED = "camera:", "instruction", "closed"


class ActionLayout(Frozen):
    """Conversion of a policy's reply into actions of the control."""

    key: str | None = None  # entry of the reply that holds the actions; None: the reply itself
    # last column: ``signed`` is the control's own (on above 0), ``positive`` is on above 0.5 (a gripper's position,
    # 0 open, 1 closed), ``inverted`` is on below 0.5
    gripper: Literal["signed", "positive", "inverted"] = "signed"


class Layout(Frozen):
    """The names and units of a policy's observations and actions."""

    control: ControlName = "joint_position"
    execute: Annotated[int, Field(ge=1, le=1000)] | None = None  # actions of a chunk that are carried out; None: all
    image_size: tuple[Annotated[int, Field(ge=16, le=2048)], Annotated[int, Field(ge=16, le=2048)]] = (224, 224)
    joints: Annotated[int, Field(ge=1, le=64)] | None = None  # of the arms that the policy is for; None: any
    # a policy's name -> ``camera:NAME``, ``instruction``, ``closed`` (the hand: 0 wide open, 1 closed; 1 of a cup that
    # holds), or a part of the environment's state; names joined by ``+`` are concatenated
    observation: dict[str, str] = Field(default_factory=dict[str, str])
    action: ActionLayout = ActionLayout()

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras that the observations show."""
        sources = self.observation.values()
        return tuple(dict.fromkeys(name.removeprefix(CAMERA) for name in sources if name.startswith(CAMERA)))

    def rename_observation(
        self, observed: Mapping[str, npt.NDArray[Any]], instruction: str, stroke: float | None = None
    ) -> Observation:
        """The environment's observation under the policy's names; ``stroke`` (m): of a hand with fingers."""
        renamed: Observation = {}
        closed = observed.get("suction") if stroke is None else 1.0 - observed["gripper"] / stroke
        known = dict(observed) if closed is None else {**observed, CLOSED: closed}
        for name, source in self.observation.items():
            if source == INSTRUCTION:
                renamed[name] = instruction
            elif source.startswith(CAMERA):
                renamed[name] = observed[f"{source.removeprefix(CAMERA)}_rgb"]
            else:
                parts = [part.strip() for part in source.split("+")]
                if values := [np.ravel(known[part]) for part in parts if part != "gripper" or stroke is not None]:
                    renamed[name] = np.concatenate(values).astype(np.float32)
        return renamed

    def read_actions(self, reply: Any, columns: int) -> npt.NDArray[np.float64]:
        """The actions (T, D) of a reply: a chunk (T, D) or a single action (D,).

        Raises:
            ValueError: it is no finite array of D columns; the message says what it is.
        """
        value: Any = reply
        if self.action.key is not None:
            fields: dict[Any, Any] = dict(cast("Mapping[Any, Any]", reply)) if isinstance(reply, Mapping) else {}
            if self.action.key not in fields:
                raise ValueError(f"the reply has no {self.action.key!r}, but {str(list(fields))[:200]}")
            value = fields[self.action.key]
        actions = np.atleast_2d(np.asarray(value, dtype=np.float64))
        if actions.ndim != 2 or actions.shape[1] != columns or not len(actions):
            raise ValueError(f"actions have the shape {np.shape(value)}, the control takes (T, {columns})")
        if not np.isfinite(actions).all():
            raise ValueError("actions are not finite")
        actions = actions[: self.execute].copy()
        if self.action.gripper != "signed":
            closed = actions[:, -1] > 0.5
            actions[:, -1] = np.where(closed == (self.action.gripper == "positive"), 1.0, -1.0)
        return actions


_STATE = ("joint_velocities", *AGENT_STATE, *TASK_STATE)
PRESETS: Final[Mapping[str, Layout]] = {
    "grs": Layout(observation={**{name: name for name in _STATE}, "instruction": INSTRUCTION}),
    # keys of our LeRobot data sets
    "lerobot": Layout(
        observation={
            "observation.state": "+".join(AGENT_STATE),
            "observation.velocity": "joint_velocities",
            "observation.environment_state": "+".join(TASK_STATE),
            "observation.images.front": "camera:front",
            "observation.images.wrist": "camera:wrist",
            "task": INSTRUCTION,
        },
    ),
    # of openpi's DROID policies (github.com/Physical-Intelligence/openpi, examples/droid)
    "droid": Layout(
        control="joint_velocity",
        execute=8,
        joints=7,
        observation={
            "observation/exterior_image_1_left": "camera:photo",
            "observation/exterior_image_2_left": "camera:front",
            "observation/wrist_image_left": "camera:wrist",
            "observation/joint_position": "joint_positions",
            "observation/gripper_position": CLOSED,
            "prompt": INSTRUCTION,
        },
        action=ActionLayout(key="actions", gripper="positive"),
    ),
}


def read_layout(name: str) -> Layout:
    """The preset of a name, or the layout in a TOML file.

    Raises:
        UnknownNameError: there is neither.
        InputError: the file is no layout.
    """
    if name in PRESETS:
        return PRESETS[name]
    file = Path(name)
    if file.suffix.lower() != ".toml" or not file.is_file():
        raise UnknownNameError("layout", name, [*PRESETS, "a TOML file"])
    try:
        return Layout.model_validate(tomllib.loads(read_text(file)))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{file} is no TOML: {error}", "mend the file") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{file}: {where}: {first['msg']}", f"fields are {', '.join(Layout.model_fields)}") from error
