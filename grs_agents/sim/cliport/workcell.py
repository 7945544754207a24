"""The table with its arm and cameras, under the names that CLIPort programs use to drive and look by hand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.cliport import cameras, end_effectors
from grs_agents.sim.instance.episode import SimulationError, UnsupportedError
from grs_agents.sim.motion import placement, tool_paths
from grs_agents.sim.rendering.views import VisibleScene
from grs_agents.sim.world.recording import Recording
from grs_agents.sim.world.tabletop import Tabletop, parse_pose

_SPEED: Final = 1.0
"""Radians a second of the fastest joint in ``movej``."""
_REACHED: Final = 0.01


class UnreachableError(SimulationError):
    """The arm cannot bring its tip to a pose."""

    outcome = "unreachable"


@dataclass(frozen=True)
class ActionSpace:
    """Actions are ``{'pose0': pose, 'pose1': pose}``, positions within ``low`` and ``high`` (3,), metres."""

    low: FloatArray
    high: FloatArray

    def sample(self, rng: np.random.Generator) -> dict[str, Pose]:
        """A random action, without turning."""
        points = rng.uniform(self.low, self.high, (2, 3)).tolist()
        return {f"pose{index}": parse_pose((point, None), "action") for index, point in enumerate(points)}

    def contains(self, action: Any) -> bool:
        """Whether an action has both poses, within the bounds."""
        try:
            poses = [parse_pose(action[key], key) for key in ("pose0", "pose1")]
        except (SimulationError, KeyError, TypeError):
            return False
        return all((self.low <= pose[0]).all() and (pose[0] <= self.high).all() for pose in poses)


class Workcell(Tabletop):
    """A table, the arm behind it, three cameras around it."""

    record_cfg: Any = None
    _recording: "tuple[str, Recording] | None" = None

    @property
    def homej(self) -> FloatArray:
        """Joint positions (dof,) of the waiting arm, radians."""
        return self.arm.home_joints.copy()

    @property
    def ee(self) -> end_effectors.Suction | end_effectors.Spatula:
        """What is at the end of the arm."""
        return end_effectors.Spatula() if self.tool == "spatula" else end_effectors.Suction()

    @property
    def agent_cams(self) -> list[cameras.CameraConfig]:
        """The three observation cameras, for ``render_camera``."""
        return [dict(config) for config in cameras.AGENT_CAMERAS]

    @property
    def action_space(self) -> ActionSpace:
        """Where actions may pick and place."""
        return ActionSpace(self.bounds[:, 0], self.bounds[:, 1])

    def solve_ik(self, pose: Any) -> FloatArray:
        """Joint positions (dof,), near the present ones, that bring the cup's tip to a pose.

        The pose is a position (m) and how the tool is turned (xyzw) from pointing straight down; it may tilt. Raises
        ``UnreachableError`` where limits, the table or the arm itself are in the way.
        """
        position, rotation = parse_pose(pose, "solve_ik")
        _, tilt = tool_paths.split_into_yaw_and_tilt(rotation)
        tilted, physics = bool(np.any(tilt)), self.physics
        if not tilted and not self.arm.can_reach_point(position):
            raise UnreachableError(
                f"{placement.format_point(position)} {placement.describe_out_of_reach(position, self.arm)}",
                "give a pose within reach",
            )
        joints = self.arm.solve_ik_for_poses(
            np.array([position]), transforms.quaternion_to_matrix(rotation)[None], physics.commanded_joint_positions
        )
        how = f"with the tool tilted by {np.linalg.norm(tilt):.2f} rad" if tilted else "with the tool down"
        if not self.arm.is_path_within_limits(joints):
            raise UnreachableError(
                f"{placement.format_point(position)} cannot be reached {how}", "give a pose within reach"
            )
        if (gap := self.arm.first_collision_along(joints)) is not None:
            raise UnreachableError(
                f"{placement.format_point(position)} cannot be reached {how}: {gap}", "give a pose within reach"
            )
        return joints[0]

    def movej(self, targj: Sequence[float] | FloatArray, speed: float = 0.01, timeout: float = 20) -> bool:
        """Move the arm straight to joint positions (dof,), within ``timeout`` seconds; True if it failed to arrive.

        Raises ``UnreachableError``, before it moves, beyond a joint's limits or where it would hit the table or itself.
        """
        del speed
        physics, target = self.physics, np.asarray(targj, dtype=np.float64)
        if target.shape != (self.arm.dof,) or not np.isfinite(target).all():
            count = self.arm.dof
            raise SimulationError(f"movej: {targj!r} are not {count} joint positions", f"give {count} finite numbers")
        if not self.arm.is_path_within_limits(target[None]):
            bounds = [
                f"{low:.2f}..{high:.2f}"
                for low, high in zip(self.arm.lower_joint_limits, self.arm.upper_joint_limits, strict=True)
            ]
            raise UnreachableError(f"movej: {targj!r} is beyond the joints' limits", f"stay within {', '.join(bounds)}")
        start = physics.joint_positions
        seconds = 1.5 * float(np.abs(target - start).max()) / _SPEED
        share = np.linspace(0.0, 1.0, max(2, int(seconds / self.timestep)))[:, None]
        path = start + (3 * share**2 - 2 * share**3) * (target - start)
        path = path[: max(2, int(timeout / self.timestep))]
        if (gap := self.arm.first_collision_along(path)) is not None:
            raise UnreachableError(
                f"movej: on its way {gap}", "give joint positions that keep it clear, e.g. of env.solve_ik(pose)"
            )
        physics.follow_joint_path(path)
        physics.wait_for_joint_positions(path[-1])
        return bool(np.abs(physics.joint_positions - target).max() > _REACHED)

    def movep(self, pose: Any, speed: float = 0.01) -> bool:
        """Move the cup's tip to a pose; returns whether it failed to arrive, as ``movej``."""
        return self.movej(self.solve_ik(pose), speed)

    @property
    def visible_scene(self) -> VisibleScene:
        """What there is to see now."""
        joints = self.homej if self._physics is None else self._physics.joint_positions
        poses = tuple(self.get_object_pose(number) for number in self._objects)
        return VisibleScene(
            tuple(self._objects.values()), self.library, joints, self.arm, self.tool, poses, self.background
        )

    def render_camera(
        self, config: Mapping[str, Any], *_: Any, **__: Any
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Colour (H, W, 3), depth (H, W; m along the optical axis) and object id (H, W; -1 = none) of one camera."""
        picture = cameras.render_from_camera_config(self.visible_scene, config)
        return picture.color, picture.depth, picture.owner

    def render(self, mode: str = "rgb_array") -> npt.NDArray[np.uint8]:
        """What the front camera sees (480, 640, 3); there is no window, so other modes are an ``UnsupportedError``."""
        if mode != "rgb_array":
            raise UnsupportedError(f"render(mode={mode!r}): there is no window", "use mode='rgb_array'")
        return self.render_camera(cameras.AGENT_CAMERAS[0])[0]

    def start_rec(self, video_filename: str) -> None:
        """Record the motion of every object and link from now on, until ``end_rec``."""
        if self._recording is not None:
            raise SimulationError("start_rec: a recording is under way", "call env.end_rec() first")
        physics = self.physics
        self._recording = (str(video_filename), Recording(physics, {item.id: item.id for item in self.objects}))

    def end_rec(self) -> Path:
        """End the recording and return its file, ``<save_video_path>/<name>.npz``, by default in the working folder."""
        if self._recording is None:
            raise SimulationError("end_rec: nothing is being recorded", "call env.start_rec(name) first")
        (name, recording), self._recording = self._recording, None
        folder = Path(str(dict(self.record_cfg or {}).get("save_video_path", ".")))
        return recording.save(folder / f"{Path(name).name}.npz")
