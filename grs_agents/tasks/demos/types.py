"""Types of demonstrations: episodes at the control rate as arrays, and the card of a data set."""

import importlib.metadata
import platform
from dataclasses import dataclass, field
from typing import Any, Final, Literal, get_args

import numpy as np
import numpy.typing as npt
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.version import __version__

Format = Literal["lerobot", "robomimic", "minari"]
FORMATS: Final[tuple[Format, ...]] = ("lerobot", "robomimic", "minari")
DemoControl = Literal["joint_position", "ee_delta"]
DEMO_CONTROLS: Final[tuple[DemoControl, ...]] = get_args(DemoControl)
ENVIRONMENT: Final = "grs_agents.envs:GRS-v0"
"""Gymnasium id of the environment of a data set."""
Floats = npt.NDArray[np.float32]
Row = tuple[float, ...]


class CameraModel(Frozen):
    """A pinhole camera without distortion, OpenCV axes (x right, y down, z along the optical axis)."""

    name: str
    width: int  # pixels
    height: int
    intrinsics: tuple[Row, ...]  # (3, 3), pixels; the centre of the first pixel is at (0, 0)
    frame: Literal["robot", "tip"]  # that it is fixed to: the robot's base, or the tip of the tool
    pose: tuple[Row, ...]  # T_frame_camera (4, 4), metres


@dataclass(frozen=True)
class Demonstration:
    """An episode replayed through the environment: T steps between T + 1 observations.

    Row t of ``executed_actions`` was applied to row t of the observations, and led to row t + 1. Positions are in
    metres in the robot frame, rotations xyzw, joints radians (slides: metres).
    """

    instance: str  # the task instance as JSON
    instance_hash: str  # sha256 of it
    language: str  # the task in words
    robot: str  # the arm's name
    control: DemoControl  # that the actions are for
    joint_names: tuple[str, ...]  # dof
    rate: float  # steps a second
    joint_positions: Floats  # (T + 1, dof)
    joint_velocities: Floats  # (T + 1, dof)
    tip: Floats  # (T + 1, 7) position of the cup's tip, rotation from straight down
    commanded_tip: Floats  # (T + 1, 7) the tip's pose that the arm was sent to
    suction: npt.NDArray[np.bool_]  # (T + 1,) whether the hand holds an object
    objects: Floats  # (T + 1, N, 7)
    object_names: tuple[str, ...]  # N, asset name and id in the instance
    targets: Floats  # (T + 1, N, 7) nearest place that a goal wants each object at, its own pose without any
    held: Floats  # (T + 1, N) 1 for the object in the hand
    open: Floats  # (T + 1, N) 1 for objects that are not at their place yet
    # (T, D) of the control, e.g. joint positions at the next step, then the hand: 1 to hold; suction off is -1, fingers
    # open to the share of their stroke that is the negative value
    actions: Floats
    executed_actions: Floats  # (T, D) what was carried out: ``actions``, with noise in noisy replays
    rewards: Floats  # (T,) 1 for the step that solves the task, else 0
    strict: float  # strict score at the end, 0..1
    images: dict[str, npt.NDArray[np.uint8]] = field(
        default_factory=dict[str, npt.NDArray[np.uint8]]
    )  # (T + 1, H, W, 3)
    cameras: tuple[CameraModel, ...] = ()
    gripper: Floats | None = None  # (T + 1, 1) width between the pads, metres, of a hand with fingers
    attempt: int = 0  # number of the attempt; with the order's seed, the seed of the variation
    base_seed: int = 0  # of the instance, or of the instance that it varies

    @property
    def steps(self) -> int:
        """T, the number of actions."""
        return len(self.actions)


class Dropped(Frozen):
    """An attempt that gave no demonstration, and why."""

    stage: Literal["variation", "expert", "replay"]
    why: str


class DatasetCard(Frozen):
    """Description of a data set, apart from its episodes."""

    name: str  # of the task folder
    id: str = ""  # of the data set, hexadecimal; identifies the data set wherever it lies
    # absolute output path; written only into the arguments of the environment
    folder: str = Field(default="", exclude=True)
    robot: str
    control: DemoControl
    rate: float  # Hz
    joint_names: tuple[str, ...]
    gripper: bool = False  # whether the hand has fingers
    object_names: tuple[str, ...]
    cameras: tuple[CameraModel, ...]
    versions: dict[str, str]  # of the packages that the result depends on

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the columns of an action."""
        moves = self.joint_names if self.control == "joint_position" else ("tip.x", "tip.y", "tip.z", "tip.yaw")
        return (*moves, "gripper" if self.gripper else "suction")

    @property
    def environment_arguments(self) -> dict[str, Any]:
        """Arguments of ``GRS-v0`` for the episodes' instances and control."""
        shown = {"cameras": [camera.name for camera in self.cameras]} if self.cameras else {}
        size = {"image_size": [self.cameras[0].height, self.cameras[0].width]} if self.cameras else {}
        acts = {"control": self.control, "normalized": False, "reward": "sparse"}
        return {"run": self.folder, "dataset": self.id, **acts, **shown, **size}


class DatasetSummary(Frozen):
    """Summary of a written data set."""

    format: Format
    out: str
    episodes: int
    steps: int
    dropped: dict[str, int]  # attempts without a demonstration, by stage
    reasons: tuple[str, ...] = ()  # why, the most frequent first
    opens_with: str = ""  # Python that opens it


def installed_versions() -> dict[str, str]:
    """Versions of the packages that a demonstration depends on."""
    packages = {name: importlib.metadata.version(name) for name in ("mujoco", "numpy")}
    return {"grs-agents": __version__, "python": platform.python_version(), **packages}
