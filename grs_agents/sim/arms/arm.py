"""Robot arms: inverse kinematics for the tip of the hand within joint limits, reach, and self-collision.

``Arm`` serves any serial arm of hinges and slides numerically (damped least squares on MuJoCo's Jacobian); an arm with
closed-form kinematics overrides ``solve_ik_tool_down``, ``solve_ik_for_poses`` and ``reachable_mask``.
"""

from collections.abc import Callable
from dataclasses import dataclass
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
    measure_travel,
    rotations_about_z,
)
from grs_agents.sim.hands.hand import Hand

_RADII: Final = np.arange(0.14, 1.2, 0.025)
_HEIGHTS: Final = np.concatenate([[0.001], np.arange(0.05, 0.71, 0.06)])
_BEARINGS: Final = np.linspace(-np.pi / 2, np.pi / 2, 13)
_EXPLORING: Final = 25


@dataclass(frozen=True)
class ReachTable:
    """Reach with the tool straight down, on a grid about the base axis."""

    served: npt.NDArray[np.bool_]  # (bearings, radii, heights); a single bearing stands for all
    bearings: tuple[float, float]  # lowest and highest bearing that the base allows, radians

    @property
    def reachable_radius_range(self) -> tuple[float, float]:
        """Least and greatest radius served at any bearing and height, metres."""
        radii = _RADII[self.served.any(axis=(0, 2))]
        return (float(radii.min()), float(radii.max())) if len(radii) else (0.0, 0.0)

    @property
    def greatest_height(self) -> float:
        """Greatest height served at any bearing and radius, metres."""
        return float(_HEIGHTS[self.served.any(axis=(0, 1))].max(initial=0.0))

    def __call__(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """Mask of the points (N, 3) in a cell whose corners are all served."""
        bearing, radius = np.arctan2(tips[:, 1], tips[:, 0]), np.hypot(tips[:, 0], tips[:, 1])
        inside = (bearing >= self.bearings[0]) & (bearing <= self.bearings[1])
        inside &= (radius >= _RADII[0]) & (radius <= _RADII[-1])
        inside &= (tips[:, 2] >= 0.0) & (tips[:, 2] <= _HEIGHTS[-1])
        r = (np.searchsorted(_RADII, radius, side="right") - 1).clip(0, len(_RADII) - 2)
        h = (np.searchsorted(_HEIGHTS, tips[:, 2], side="right") - 1).clip(0, len(_HEIGHTS) - 2)
        b = (np.searchsorted(_BEARINGS, bearing, side="right") - 1).clip(0, len(_BEARINGS) - 2)
        if len(self.served) == 1:
            b = np.zeros_like(b)
        corners = [(b, r + i, h + j) for i in (0, 1) for j in (0, 1)]
        if len(self.served) > 1:
            corners += [(b + 1, r + i, h + j) for i in (0, 1) for j in (0, 1)]
        for corner in corners:
            inside &= self.served[corner]
        return inside


def build_reach_table(posture: ArmModel, home: FloatArray) -> ReachTable:
    """Solve the arm's inverse kinematics on the grid, each point from a neighbour that was served."""
    turning = posture.has_vertical_base_hinge()
    bearings = np.zeros(1) if turning else _BEARINGS
    served = np.array([_reachable_cells_at_bearing(float(bearing), posture, home) for bearing in bearings])
    low, high = (posture.low[0] - home[0], posture.high[0] - home[0]) if turning else (-np.pi / 2, np.pi / 2)
    return ReachTable(served, (float(low), float(high)))


def _reachable_cells_at_bearing(bearing: float, posture: ArmModel, home: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask (R, H) of the radii and heights that the arm serves at a bearing (rad)."""
    tool = rotations_about_z(np.array([bearing]))[0] @ DOWN
    served = np.zeros((len(_RADII), len(_HEIGHTS)), dtype=bool)
    nearer: dict[int, FloatArray] = {}  # joint positions at the previous radius, by index of the height
    for row, radius in enumerate(_RADII):
        above: FloatArray | None = None
        before, nearer = nearer, dict[int, FloatArray]()
        for column in reversed(range(len(_HEIGHTS))):
            point = np.array([radius * np.cos(bearing), radius * np.sin(bearing), _HEIGHTS[column]])
            near = (above, *(before.get(column + step) for step in (0, 1, -1)))
            start = next((joints for joints in near if joints is not None), None)
            if start is None and served.any():
                continue
            above = posture.solve_ik(point, tool, home if start is None else start, home, _EXPLORING)
            if above is not None and posture.first_collision_along(above[None]) is not None:
                above = None
            if above is not None:
                served[row, column], nearer[column] = True, above
    return served


HOME: Final[Vec3] = (0.35, 0.0, 0.42)
"""Preferred position of the waiting tip, metres."""
_HOMES: Final = (
    HOME,
    (0.4, 0.0, 0.3),
    (0.5, 0.0, 0.3),
    (0.3, 0.0, 0.3),
    (0.5, 0.0, 0.2),
    (0.3, 0.0, 0.15),
    (0.22, 0.0, 0.06),
)
_FEW_GUESSES: Final = 8
"""Starts of the search for a home that are tried at every point before the others, which take seconds in vain."""
_CENTRAL: Final = 0.4
"""Greatest distance of a joint from the middle of its range, as a part of it, that ends the search without a guess."""
_NEAR: Final = 0.2


class Arm:
    """A serial arm with its base at the origin of the robot frame and a hand at its flange.

    ``add`` adds its bodies, joints (from the base on), a position actuator per joint, and the hand, with its moving
    parts or without, to a spec; ``add_dressed`` adds the same with the visual geoms of a file. Solutions are sought
    near the joint positions ``guess`` (dof,); with None the arm waits where its joints are near the middle of their
    limits.
    """

    nearest: float  # reach of the tip from the base axis, tool down, metres; for messages only
    farthest: float
    solves_rows_alone = False  # whether rows of ``solve_ik_tool_down`` depend on earlier rows by whole turns alone
    maker_speeds: FloatArray | None = None  # greatest joint speeds (dof,) of the data sheet, rad/s

    looks: tuple[Solid, ...] = ()  # shown by a rendered model in place of the geoms; empty: the geoms

    def __init__(
        self,
        name: str,
        add: Callable[[Any, bool], None],
        guess: FloatArray | None,
        hand: Hand,
        add_dressed: Callable[[Any, bool], None] | None = None,
    ) -> None:
        self.name, self.hand = name, hand
        self._add, self._guess, self._add_dressed = add, guess, add_dressed or add

    def add(self, spec: Any, dressed: bool = False) -> None:
        """Add the robot to a spec, ``dressed`` with the visual geoms of its file."""
        (self._add_dressed if dressed else self._add)(spec, True)

    def describe_reach(self) -> str:
        """Reach of the tip with the tool down, in words."""
        if not self.farthest:
            return "nothing with the tool down"
        height = self._reachability_grid.greatest_height
        return (
            f"{self.nearest:.2f} to {self.farthest:.2f} m from its base, up to {height:.2f} m high, with the tool down"
        )

    def _add_rigid(self, spec: Any) -> None:
        self._add(spec, False)

    def __getattr__(self, name: str) -> float:
        """``nearest`` and ``farthest``, computed from the reach table on first access."""
        if name not in ("nearest", "farthest"):
            raise AttributeError(name)
        self.nearest, self.farthest = self._reachability_grid.reachable_radius_range
        return self.nearest if name == "nearest" else self.farthest

    @cached_property
    def _arm_model(self) -> ArmModel:
        return build_arm_model_ignoring_home_contacts(self._add_rigid, self.home_joints, self.hand.body)

    @cached_property
    def _reachability_grid(self) -> ReachTable:
        return build_reach_table(self._arm_model, self.home_joints)

    @cached_property
    def home_joints(self) -> FloatArray:
        """Joint positions (dof,) of the waiting arm: radians, or metres of a slide."""
        posture = ArmModel(self._add_rigid, hand=self.hand.body)
        spread = np.random.default_rng(0).random((60, posture.dof))
        middle, span = (posture.low + posture.high) / 2, posture.high - posture.low
        guesses = [*(() if self._guess is None else (self._guess,)), middle, *posture.low + span * spread]
        homes = [point for point in np.array(_HOMES) if posture.is_within_span(point, DOWN)]

        def offset(joints: FloatArray) -> FloatArray:
            """Distance of each joint from the middle of its range, 0..1/2 of the range."""
            return np.abs(joints - middle) / span

        for some in (guesses[:_FEW_GUESSES], guesses[_FEW_GUESSES:]):
            best: FloatArray | None = None
            for point in homes:
                for guess in some:
                    joints = posture.solve_ik(point, DOWN, guess, guess, 200)
                    if joints is not None and self._guess is not None:
                        return joints
                    if joints is not None and (best is None or (offset(joints) ** 2).sum() < (offset(best) ** 2).sum()):
                        best = joints
                if best is not None and offset(best).max() <= _CENTRAL:
                    return best
            if best is not None:
                return best
        raise InputError(
            f"robot {self.name}: it cannot point its tool straight down anywhere between (0.22, 0, 0.06) and "
            "(0.5, 0, 0.42) m",
            "its base must be at the origin, x forward, the table top at z = 0, and z of its tip's site point outwards",
        )

    @property
    def dof(self) -> int:
        """Number of joints."""
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
        """Greatest joint speeds (dof,), rad/s, or m/s of a slide. MJCF has none, so an arm without a data sheet takes
        typical values of a light arm: half a turn, or a metre, a second."""
        return np.where(self._arm_model.slides, 1.0, np.pi) if self.maker_speeds is None else self.maker_speeds

    def inertia_matrix(self, joints: FloatArray) -> FloatArray:
        """Joint-space inertia (dof, dof) at positions (dof,), with nothing in the hand."""
        return self._arm_model.inertia_matrix(joints)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the bodies, the hand's last."""
        return self._arm_model.links

    def tip_pose(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (3,) of the tip, m, and its rotation (3, 3) from the tool straight down, at joints (dof,)."""
        return self._arm_model.tip_pose(joints)

    def tip_height(self, joints: FloatArray) -> float:
        """Height of the tip, m, at joints (dof,)."""
        return self._arm_model.tip_height(joints)

    def tip_poses(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As ``tip_pose``, (N, 3) and (N, 3, 3), at joint positions (N, dof)."""
        return self._arm_model.tip_poses(path)

    def shift_tip(self, joints: FloatArray, twist: FloatArray) -> FloatArray:
        """Joint positions (dof,) after a small twist (6,) of the tip (m, then rad), to first order, within limits."""
        return self._arm_model.shift_tip(joints, twist)

    def solve_ik_tool_down(self, tips: FloatArray, yaws: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """Continuous joint positions (N, dof) along a path of the tip (N, 3; m), tool down; NaN where unreachable.
        The ``yaws`` (N,) are not wrapped, so that a path may turn on and on. It starts at ``seed``, None for home."""
        return self.solve_ik_for_poses(tips, rotations_about_z(yaws), seed)

    def solve_ik_for_poses(self, tips: FloatArray, rotations: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``solve_ik_tool_down``, with the tool rotated by (N, 3, 3) from straight down: it may tilt."""
        joints = self.home_joints if seed is None else seed
        travel, solutions = measure_travel(tips, rotations), list[FloatArray]()
        rows = choose_waypoint_indices(travel)
        for index, row in enumerate(rows):
            ahead = joints if index < 2 else 2 * solutions[-1] - solutions[-2]
            solved = self._arm_model.solve_ik(
                tips[row], rotations[row] @ DOWN, ahead, self.home_joints, 60 if index else 200
            )
            if solved is None or (index and float(np.abs(solved - joints).max()) > 1.0):
                return np.full((len(tips), self.dof), np.nan)
            solutions.append(solved)
            joints = solved
        return hermite_spline_points(np.array(solutions), rows, travel)

    def reachable_mask(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """Mask of the points (N, 3) that the tip can reach, tool down, clear of the table and of the arm itself."""
        return self._reachability_grid(tips)

    def can_reach_point(self, tip: Vec3) -> bool:
        """Whether the tip can reach a point, tool down."""
        return bool(self.reachable_mask(np.array([tip], dtype=np.float64))[0])

    def is_path_within_limits(self, path: FloatArray) -> bool:
        """Whether joint positions (N, dof) are all finite and within the limits."""
        low, high = path.min(axis=0), path.max(axis=0)  # NaN if any row is, which fails both comparisons
        return bool(((low >= self.lower_joint_limits - 1e-6) & (high <= self.upper_joint_limits + 1e-6)).all())

    def find_collision_at_joints(self, joints: FloatArray) -> Collision | None:
        """The first collision of the arm with the table or itself at joint positions (dof,)."""
        return self._arm_model.first_collision_along(joints[None])

    def first_collision_along(self, path: FloatArray) -> Collision | None:
        """The first such collision along joint positions (N, dof), checked every ``_NEAR`` rad."""
        travel = np.zeros(len(path))
        np.abs(path[1:] - path[:-1]).max(axis=1).cumsum(out=travel[1:])
        count = max(2, int(np.ceil(travel[-1] / _NEAR)) + 1)
        return self._arm_model.first_collision_along(path[evenly_spaced_indices(travel, count)])
