"""Timed joint paths: way points at equal time intervals, and the commands that make the arm follow them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms import joint_paths
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS

_TOP_SPEED = 0.95
"""Share of its joints' speed limits that the arm uses, since it overshoots a little."""

_TIME: FloatArray = np.linspace(0.0, 1.0, 9)[:, None]
_SHIFT: FloatArray = _TIME * _TIME * (3 - 2 * _TIME)
"""Shares (9, 1) of a change of posture at its way points, a smoothstep; with fewer it exceeds the speed limits."""


@dataclass(frozen=True)
class JointWay:
    """Joint positions (K, dof), ``WAYPOINT_STEPS`` time steps apart, from the present ones; at rest between legs."""

    joints: FloatArray
    speeds: FloatArray  # (K, dof), of the joints, rad or m a second
    torques: FloatArray  # (K, dof), for the accelerations
    seconds: float  # between two way points
    last_leg: int  # first way point of the last leg

    @property
    def steps(self) -> int:
        """Duration in time steps."""
        return (len(self.joints) - 1) * WAYPOINT_STEPS

    def since(self, waypoint: int) -> "JointWay":
        """The rest of the path from a way point on."""
        if not waypoint:
            return self
        rest = (self.joints[waypoint:], self.speeds[waypoint:], self.torques[waypoint:])
        return JointWay(*rest, self.seconds, max(0, self.last_leg - waypoint))

    def command_at(self, step: int, lead: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Joint positions (dof,) to command for a time step.

        They lead the path by the lag of damping (``lead``, s) and inertia, so that the arm keeps to it.
        """
        row, beyond = divmod(step, WAYPOINT_STEPS)
        if not beyond:
            return self.joints[row] + self.speeds[row] * lead + self.torques[row] / stiffness
        ahead = self.speeds[row : row + 2] * lead + self.torques[row : row + 2] / stiffness
        share = beyond / WAYPOINT_STEPS
        (start, end), (leaving, arriving) = self.joints[row : row + 2], self.speeds[row : row + 2] * self.seconds
        between = joint_paths.between_waypoints(start, end, leaving, arriving, share)
        return between + ahead[0] + share * (ahead[1] - ahead[0])


def pace_legs(
    legs: Sequence[FloatArray],
    arm: Arm,
    timestep: float,
    spacing: int = WAYPOINT_STEPS,
    present: FloatArray | None = None,
) -> JointWay:
    """Time legs one after the other, slowed to the joints' speed limits.

    Each leg has way points (K, dof), ``spacing`` time steps apart (1 or ``WAYPOINT_STEPS``). Where they begin farther
    from ``present`` (dof,) than the arm moves between two, a leg from there comes first: numerical inverse kinematics
    may leave a redundant arm's posture for another with the same tip.
    """
    if spacing != WAYPOINT_STEPS:
        legs = [leg[[*range(0, len(leg) - 1, WAYPOINT_STEPS // spacing), -1]] for leg in legs]
    seconds, limits = WAYPOINT_STEPS * timestep, _TOP_SPEED * arm.joint_speed_limits
    if present is not None and (np.abs(legs[0][0] - present) > limits * seconds).any():
        legs = [present + _SHIFT * (legs[0][0] - present), *legs]
    slowed = [joint_paths.slow_to_speed_limits(leg, seconds, limits) for leg in legs]
    corners = list(accumulate((len(leg) - 1 for leg in slowed), initial=0))
    joints = slowed[0] if len(slowed) == 1 else np.concatenate([slowed[0], *(leg[1:] for leg in slowed[1:])])
    speeds = joint_paths.joint_speeds(joints, seconds)
    for corner in corners:
        speeds[corner] = 0.0
    torques = joint_paths.joint_speeds(speeds, seconds)
    for start, end in pairwise(corners):
        torques[start:end] @= arm.inertia_matrix(joints[(start + end) // 2])
    torques[-1] = 0.0
    return JointWay(joints, speeds, torques, seconds, corners[-2])
