"""State observations of environments: robot and objects as named float32 arrays."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray, matrix_to_quaternion
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.hands.two_fingers import TwoFingerHand
from grs_agents.tasks.envs.controls import Control
from grs_agents.tasks.envs.goal_progress import GoalProgress, ShapingState
from grs_agents.tasks.envs.task_episode import TaskEpisode

Floats = npt.NDArray[np.float32]
AGENT_STATE: Final = ("joint_positions", "gripper", "suction", "tip", "commanded_tip")
"""Parts of LeRobot's ``agent_pos``, which is ``observation.state`` of data sets; ``gripper`` of fingers alone."""
TASK_STATE: Final = ("objects", "targets", "held", "open")
"""Parts of LeRobot's ``environment_state``, which is ``observation.environment_state`` of data sets."""
_FARTHEST: Final = 3.0
"""Bound of observed coordinates, metres from the base."""
_FASTEST: Final = 10.0
"""Bound of observed joint speeds, rad/s."""
_POSE: Final = [_FARTHEST] * 3 + [1.0] * 4


class StateReader:
    """Reads the state of an episode: ``shapes``, and bounds ``low`` and ``high``, by name.

    * ``joint_positions``, ``joint_velocities`` (dof,): rad and rad/s (slides: m).
    * ``tip`` (7,): the tool's tip, position (m) and rotation (xyzw) from straight down.
    * ``commanded_tip`` (7,): the same of the pose that it was sent to: the arm lags behind.
    * ``suction`` (1,): 1 while an object is held.
    * ``held`` (N,): 1 for that object.
    * ``objects`` (N, 7): poses of the task's objects, in the instance's order; zeros for rows beyond them.
    * ``targets`` (N, 7): the place that a goal wants each of them at, its own pose without any.
    * ``open`` (N,): 1 for objects that are not at their place yet.
    * ``gripper`` (1,): width between the pads, metres; of a hand with fingers alone.
    """

    def __init__(self, arm: Arm, rows: int) -> None:
        dof = arm.dof
        limits: dict[str, tuple[list[float] | FloatArray, list[float] | FloatArray]] = {
            "joint_positions": (arm.lower_joint_limits - 0.1, arm.upper_joint_limits + 0.1),
            "joint_velocities": ([-_FASTEST] * dof, [_FASTEST] * dof),
            "tip": ([-bound for bound in _POSE], _POSE),
            "commanded_tip": ([-bound for bound in _POSE], _POSE),
            "suction": ([0.0], [1.0]),
            "held": ([0.0] * rows, [1.0] * rows),
            "objects": ([-bound for bound in _POSE] * rows, _POSE * rows),
            "targets": ([-bound for bound in _POSE] * rows, _POSE * rows),
            "open": ([0.0] * rows, [1.0] * rows),
        }
        if isinstance(arm.hand, TwoFingerHand):
            limits["gripper"] = [0.0], [arm.hand.stroke]
        self.shapes = {name: (len(low),) for name, (low, _) in limits.items()}
        self.shapes |= {"objects": (rows, 7), "targets": (rows, 7)}
        self._low = np.concatenate([np.asarray(low, dtype=np.float32) for low, _ in limits.values()])
        self._high = np.concatenate([np.asarray(high, dtype=np.float32) for _, high in limits.values()])
        ends = np.cumsum([len(low) for low, _ in limits.values()]).tolist()
        self._slices = {name: slice(end - len(limits[name][0]), end) for name, end in zip(limits, ends, strict=True)}
        self._dof = dof

    @property
    def low(self) -> dict[str, Floats]:
        """Least values, by name."""
        return self._split_state_by_name(self._low)

    @property
    def high(self) -> dict[str, Floats]:
        """Greatest values, by name."""
        return self._split_state_by_name(self._high)

    def _split_state_by_name(self, values: Floats) -> dict[str, Floats]:
        split = {name: values[part] for name, part in self._slices.items()}
        for name in ("objects", "targets"):
            split[name] = split[name].reshape(self.shapes[name])
        return split

    def begin(self, episode: TaskEpisode, control: Control) -> None:
        """An episode begins, in which ``control`` moves the arm."""
        self._episode, self._control, self._progress = episode, control, GoalProgress(episode)
        world, data = episode.physics.world, episode.physics.data
        bodies = [world.bodies[number] for number in episode.object_ids]
        self._bodies = np.array(bodies, dtype=np.intp)
        self._row_of = {number: row for row, number in enumerate(episode.object_ids)}
        span = slice(min(bodies, default=0), max(bodies, default=-1) + 1)
        self._places, self._turns = data.xpos[span], data.xquat[span]  # views that hold all of the objects
        self._known: object = None

    def read(self) -> tuple[dict[str, Floats], float]:
        """The state now, and the shaping potential."""
        physics = self._episode.physics
        data, dof, held = physics.data, self._dof, physics.held_object_id
        # Objects rest in most control periods.
        if self._known != (known := (self._places.tobytes(), self._turns.tobytes(), held)):
            self._known, (self._objects, self._progress_now) = known, self._read_objects(data, held)
        flat, start = self._objects.copy(), self._slices["tip"].start
        tip = data.site_xpos[physics.world.tip_site]
        flat[:dof], flat[dof : 2 * dof] = data.qpos[:dof], data.qvel[:dof]
        flat[start : start + 3], flat[start + 3 : start + 7] = tip, physics.tip_rotation()
        (sent_to, turned), start = self._control.commanded_tip, self._slices["commanded_tip"].start
        flat[start : start + 3], flat[start + 3 : start + 7] = sent_to, matrix_to_quaternion(turned)
        if "gripper" in self._slices:
            flat[self._slices["gripper"]] = physics.fingers.width
        np.minimum(np.maximum(flat, self._low, out=flat), self._high, out=flat)
        return self._split_state_by_name(flat), self._progress_now.potential(tip)

    def _read_objects(self, data: Any, held: int | None) -> tuple[Floats, ShapingState]:
        """The state's values without the arm's, and the objects' progress."""
        row = -1 if held is None else self._row_of.get(held, -1)
        poses = np.empty((len(self._bodies), 7))
        poses[:, :3], quaternions = data.xpos[self._bodies], data.xquat[self._bodies]
        poses[:, 3:6], poses[:, 6] = quaternions[:, 1:], quaternions[:, 0]
        progress = self._progress.measure(poses, row)
        flat, parts = np.zeros(len(self._low), dtype=np.float32), self._slices
        flat[parts["suction"]] = held is not None
        if row >= 0:
            flat[parts["held"].start + row] = 1.0
        for name, values in (("objects", poses), ("targets", progress.targets), ("open", progress.open)):
            begin = parts[name].start
            flat[begin : begin + values.size] = values.ravel()
        return flat, progress
