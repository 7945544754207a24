"""Controls: actions as whole picks and pushes, steps of the tip, joint positions, or joint velocities."""

import math
from typing import Final, Literal, Protocol, get_args

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.joint_controller import CONTROL_RATE, JointController
from grs_agents.tasks.envs.task_episode import TaskEpisode

ControlName = Literal["pick_place", "push", "ee_delta", "joint_position", "joint_velocity"]
CONTROLS: Final[tuple[ControlName, ...]] = get_args(ControlName)
LARGEST_STEPS: Final[FloatArray] = np.array([0.03, 0.03, 0.03, 0.2])
"""Largest steps of the tip in a control period of ``ee_delta``: metres along x, y and z, radians about the vertical."""
LOWEST_TIP: Final = 0.001
"""Lowest target height of the tip, metres."""
_MISSED: Final = 2e-4
"""Most that inverse kinematics misses an aim by, m or rad: twice its tolerance. Farther off the arm was held up."""
_WORKSPACE: Final = ((0.1, 0.9), (-0.75, 0.75))
"""Bounds of x and y for primitives, metres."""
_SECONDS_PER_ACTION: Final = 6.0
"""Simulated time of an episode for each action that the task allows: the expert needs about half."""
VELOCITY_RATE: Final = 15.0
"""Rate of ``joint_velocity`` (Hz), that of DROID (Khazatsky et al. 2024), rounded to whole physics steps."""
LARGEST_VELOCITY: Final = 3.0
"""Joint speed of an action of 1 (rad/s): DROID's largest step of 0.2 rad at 15 Hz."""


class Control(Protocol):
    """Turns actions into motion, episode after episode."""

    low: FloatArray  # (D,) bounds of an action
    high: FloatArray

    @property
    def rate(self) -> float | None:
        """Actions per second; None for whole motions."""
        ...

    @property
    def commanded_tip(self) -> tuple[FloatArray, FloatArray]:
        """Commanded position (3,) of the tip, m, and its rotation (3, 3) from the tool straight down."""
        ...

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        ...

    def apply(self, action: FloatArray) -> dict[str, object]:
        """Carry out an action (D,) within the bounds; returns entries of ``info``."""
        ...

    def horizon(self, max_steps: int) -> int:
        """Actions of an episode whose task allows ``max_steps`` picks or pushes."""
        ...


class _ArmControl:
    """Control periods of a joint controller."""

    rate: float = CONTROL_RATE

    @property
    def commanded_tip(self) -> tuple[FloatArray, FloatArray]:
        """As ``Control.commanded_tip``: the tip at the end of the last period, had the arm no lag."""
        return self._controller.tip

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        self._controller = JointController(episode.physics, self.rate)

    def horizon(self, max_steps: int) -> int:
        """Control periods."""
        return round(_SECONDS_PER_ACTION * self.rate) * max_steps


class JointPositionControl(_ArmControl):
    """Joint positions at the end of the control period (rad, or m of a slide), then the hand.

    It holds above 0: suction is on, fingers close. Else suction is off, and fingers open to that share of their stroke.
    """

    def __init__(self, arm: Arm) -> None:
        self.low = np.append(arm.lower_joint_limits, -1.0)
        self.high = np.append(arm.upper_joint_limits, 1.0)

    def apply(self, action: FloatArray) -> dict[str, object]:
        """Simulate a control period."""
        self._controller.apply(action[:-1], float(action[-1]))
        return {"blocked": self._controller.blocked}


class JointVelocityControl(_ArmControl):
    """Joint speeds as shares of ``LARGEST_VELOCITY`` (slides: m/s of it), then the hand as in ``JointPositionControl``.

    A period is 1/15 s, rounded to whole physics steps: 68 ms at 4 ms.
    """

    def __init__(self, arm: Arm, timestep: float) -> None:
        self.low, self.high = np.full(arm.dof + 1, -1.0), np.full(arm.dof + 1, 1.0)
        self.rate = 1.0 / (max(1, round(1.0 / (VELOCITY_RATE * timestep))) * timestep)

    def apply(self, action: FloatArray) -> dict[str, object]:
        """Simulate a control period."""
        target = self._controller.reference + action[:-1] * (LARGEST_VELOCITY / self.rate)
        self._controller.apply(target, float(action[-1]))
        return {"blocked": self._controller.blocked}


class EeDeltaControl(_ArmControl):
    """Steps of the tip along x, y, z and a turn about the vertical, as shares of the largest, then the hand as in
    ``JointPositionControl``.

    The tool points down; the arm stays where a step is out of reach. Steps add up without drift: each begins at the aim
    of the last, which iterative kinematics meets only to its tolerance.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self.low, self.high = np.full(5, -1.0), np.full(5, 1.0)

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        super().begin(episode)
        self._aim: FloatArray | None = None  # (4,) tip, m, and yaw, rad

    def apply(self, action: FloatArray) -> dict[str, object]:
        """Simulate a control period."""
        here = self._controller.reference
        tip, rotation = self._controller.tip
        start = np.append(tip, math.atan2(rotation[1, 0], rotation[0, 0]))
        if self._aim is not None:
            missed = self._aim - start
            missed[3] = math.remainder(missed[3], 2 * math.pi)
            if np.abs(missed).max() < _MISSED:
                start += missed
        aim = start + LARGEST_STEPS * action[:4]
        aim[2] = max(aim[2], LOWEST_TIP)
        joints = self._arm.solve_ik_tool_down(aim[None, :3], aim[3:], here)[0]
        reachable = all(abs(turn) < 1.0 for turn in (joints - here).tolist())  # False for NaN
        self._aim = aim if reachable else None
        self._controller.apply(joints if reachable else here, float(action[4]))
        return {"blocked": self._controller.blocked or not reachable}


class PrimitiveControl:
    """A whole pick and place, or a push: from x, y to x, y (m), and the turn of the picked object (rad).

    Heights are those of the surfaces there.
    """

    rate: float | None = None

    def __init__(self, push: bool) -> None:
        (x0, x1), (y0, y1) = _WORKSPACE
        turn = () if push else (math.pi,)
        self.low = np.array([x0, y0, x0, y0, *(-angle for angle in turn)])
        self.high = np.array([x1, y1, x1, y1, *turn])
        self._push = push

    @property
    def commanded_tip(self) -> tuple[FloatArray, FloatArray]:
        """As ``Control.commanded_tip``, where the last motion ended."""
        physics = self._episode.physics
        return physics.arm.tip_pose(physics.commanded_joint_positions)

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        self._episode = episode

    def apply(self, action: FloatArray) -> dict[str, object]:
        """Carry out the whole motion; ``note`` says how it went."""
        physics, values = self._episode.physics, action.tolist()
        (x0, y0, x1, y1), turn = values[:4], 0.0 if self._push else values[4]
        low = high = 0.0
        if not self._push:
            low, _ = physics.surface_height_below(x0, y0)
            high, _ = physics.surface_height_below(x1, y1)
        start: Pose = ((x0, y0, low), (0.0, 0.0, 0.0, 1.0))
        end: Pose = ((x1, y1, low + high), (0.0, 0.0, math.sin(turn / 2), math.cos(turn / 2)))
        episode = self._episode.current
        episode.step({"pose0": start, "pose1": end})
        return {"note": episode.recorder.actions[-1].note}

    def horizon(self, max_steps: int) -> int:
        """Picks or pushes."""
        return max_steps


def make_control(name: str, instance: TaskInstance, arm: Arm) -> Control:
    """The control of a name for tasks like ``instance``; raises ``InputError`` for another hand."""
    if name not in CONTROLS:
        raise UnknownNameError("control", name, CONTROLS)
    if name in ("pick_place", "push"):
        if name != instance.primitive:
            tool = "a spatula" if instance.primitive == "push" else f"the hand {instance.hand}"
            raise InputError(f"control {name!r}: the task's robot has {tool}", f"use control={instance.primitive!r}")
        return PrimitiveControl(name == "push")
    if name == "joint_velocity":
        return JointVelocityControl(arm, instance.timestep)
    steps = 1.0 / (CONTROL_RATE * instance.timestep)
    if abs(steps - round(steps)) > 1e-6:
        message = f"control {name!r}: {CONTROL_RATE:g} Hz is no whole number of {1000 * instance.timestep:g} ms steps"
        raise InputError(message, f"use control={instance.primitive!r}")
    return JointPositionControl(arm) if name == "joint_position" else EeDeltaControl(arm)
