"""What a robot arm can do: bring the suction cup to poses within its joints' limits, and keep clear of itself.
``Arm`` serves any serial arm of hinges and slides by numbers (damped least squares on MuJoCo's Jacobian); an arm whose
kinematics have a closed form overrides ``solve_ik_tool_down``, ``solve_ik_for_poses`` and ``reachable_mask``."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm_looks import Solid
from grs_agents.sim.arms.arm_model import ArmModel, Collision, build_arm_model_ignoring_home_contacts
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.arms.joint_paths import (
    choose_waypoint_indices,
    evenly_spaced_indices,
    hermite_spline_points,
    rotations_about_z,
)
from grs_agents.sim.arms.reach_table import ReachTable, build_reach_table

HOME: Final[Vec3] = (0.35, 0.0, 0.42)
"""Where the tip waits if the arm can bring it there, metres."""
_HOMES: Final = (HOME, (0.4, 0.0, 0.3), (0.5, 0.0, 0.3), (0.3, 0.0, 0.3), (0.5, 0.0, 0.2), (0.3, 0.0, 0.15))
_NEAR: Final = 0.2


class Arm:
    """A serial arm whose base is at the origin of the robot frame, with the suction cup at its end.
    ``add`` adds its bodies, joints (in their order from the base on), one position actuator a joint, the body ``cup``
    and the site ``tip`` to a world. It works near the joint angles ``guess`` (dof,)."""

    nearest: float  # from the base axis to where the tip can be brought, tool down, metres; for words only
    farthest: float
    solves_rows_alone = False  # whether a row of ``solve_ik_tool_down`` depends on those before it by whole turns alone
    maker_speeds: FloatArray | None = None  # the greatest speeds (dof,) of the joints by the maker's data sheet, rad/s

    looks: tuple[Solid, ...] = ()  # that a drawn model shows in place of its geoms; none: these are its looks

    def __init__(self, name: str, add: Callable[[Any], None], guess: FloatArray) -> None:
        self.name, self.add = name, add
        self._guess = guess

    def __getattr__(self, name: str) -> float:
        """``nearest`` and ``farthest``, from the table of reach, when they are first asked for."""
        if name not in ("nearest", "farthest"):
            raise AttributeError(name)
        self.nearest, self.farthest = self._reachability_grid.reachable_radius_range
        return self.nearest if name == "nearest" else self.farthest

    @cached_property
    def _arm_model(self) -> ArmModel:
        return build_arm_model_ignoring_home_contacts(self.add, self.home_joints)

    @cached_property
    def _reachability_grid(self) -> ReachTable:
        return build_reach_table(self._arm_model, self.home_joints)

    @cached_property
    def home_joints(self) -> FloatArray:
        """Joint positions (dof,) of the waiting arm: radians, or metres of a slide."""
        posture = ArmModel(self.add)
        spread = np.random.default_rng(0).random((60, posture.dof))
        guesses = [self._guess, (posture.low + posture.high) / 2, *posture.low + (posture.high - posture.low) * spread]
        for point in _HOMES:
            for guess in guesses:
                joints = posture.solve_ik(np.array(point), DOWN, guess, guess, 200)
                if joints is not None:
                    return joints
        raise InputError(
            f"robot {self.name}: it cannot point its tool straight down anywhere between (0.3, 0, 0.15) and "
            "(0.5, 0, 0.42) m",
            "its base must be at the origin, x forward, the table top at z = 0, and z of its tip's site point outwards",
        )

    @property
    def dof(self) -> int:
        """How many joints it has."""
        return len(self.home_joints)

    @property
    def lower_joint_limits(self) -> FloatArray:
        """Lowest joint positions (dof,)."""
        return self._arm_model.low

    @property
    def upper_joint_limits(self) -> FloatArray:
        """Highest joint positions (dof,)."""
        return self._arm_model.high

    @cached_property
    def joint_speed_limits(self) -> FloatArray:
        """The greatest speeds (dof,) of the joints, rad/s, or m/s of a slide. MJCF has no word for them, so an arm
        whose maker's figures are not known takes the usual ones of a light arm: half a turn, or a metre, a second."""
        return np.where(self._arm_model.slides, 1.0, np.pi) if self.maker_speeds is None else self.maker_speeds

    def inertia_matrix(self, joints: FloatArray) -> FloatArray:
        """The inertia (dof, dof) that the joints feel at positions (dof,), with nothing on the cup."""
        return self._arm_model.inertia_matrix(joints)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of its bodies, the cup last."""
        return self._arm_model.links

    def tip_pose(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (3,) of the tip, m, and its rotation (3, 3) from the tool straight down at joints (dof,)."""
        return self._arm_model.tip_pose(joints)

    def tip_poses(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As ``tip_pose``, (N, 3) and (N, 3, 3), at joint positions (N, dof)."""
        return self._arm_model.tip_poses(path)

    def solve_ik_tool_down(self, tips: FloatArray, yaws: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """Joint positions (N, dof) along a path of the tip (N, 3; m), tool down: continuous, NaN where the arm cannot.
        The ``yaws`` (N,) are not wrapped, so that a path may turn on and on. It begins at ``seed``, None for home."""
        return self.solve_ik_for_poses(tips, rotations_about_z(yaws), seed)

    def solve_ik_for_poses(self, tips: FloatArray, rotations: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``solve_ik_tool_down``, the tool turned by ``rotations`` (N, 3, 3) from straight down: it may tilt."""
        joints = self.home_joints if seed is None else seed
        rows, found = choose_waypoint_indices(tips, rotations), list[FloatArray]()
        for index, row in enumerate(rows):
            ahead = joints if index < 2 else 2 * found[-1] - found[-2]
            solved = self._arm_model.solve_ik(
                tips[row], rotations[row] @ DOWN, ahead, self.home_joints, 60 if index else 200
            )
            if solved is None or (index and float(np.abs(solved - joints).max()) > 1.0):
                return np.full((len(tips), self.dof), np.nan)
            found.append(solved)
            joints = solved
        return hermite_spline_points(np.array(found), rows, len(tips))

    def reachable_mask(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the points (N, 3) the tip can be brought to, tool down, clear of the table and of itself."""
        return self._reachability_grid(tips)

    def can_reach_point(self, tip: Vec3) -> bool:
        """Whether the arm can bring the tip to one point, tool down."""
        return bool(self.reachable_mask(np.array([tip], dtype=np.float64))[0])

    def is_path_within_limits(self, path: FloatArray) -> bool:
        """Whether joint positions (N, dof) are all finite and within the limits."""
        low, high = path.min(axis=0), path.max(axis=0)  # NaN where any is, which no comparison holds for
        return bool(((low >= self.lower_joint_limits - 1e-6) & (high <= self.upper_joint_limits + 1e-6)).all())

    def find_collision_at_joints(self, joints: FloatArray) -> Collision | None:
        """What of the arm meets the table or itself at joint positions (dof,)."""
        return self._arm_model.first_collision_along(joints[None])

    def first_collision_along(self, path: FloatArray) -> Collision | None:
        """Where the arm first meets the table or itself along joint positions (N, dof), seen every ``_NEAR`` rad."""
        travel = np.zeros(len(path))
        np.abs(path[1:] - path[:-1]).max(axis=1).cumsum(out=travel[1:])
        count = max(2, int(np.ceil(travel[-1] / _NEAR)) + 1)
        return self._arm_model.first_collision_along(path[evenly_spaced_indices(travel, count)])
