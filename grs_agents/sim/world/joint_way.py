"""A way of the arm: way points in even times, and the commands that lead through them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms import joint_paths
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS

_TOP_SPEED = 0.95
"""How much of its joints' speeds the arm is told to use, since it swings a little beyond."""


@dataclass(frozen=True)
class JointWay:
    """Joint positions (K, dof), each ``WAYPOINT_STEPS`` time steps after the one before; the first is where the arm is.
    It rests where one leg ends and the next begins."""

    joints: FloatArray
    speeds: FloatArray  # (K, dof), of the joints, rad or m a second
    torques: FloatArray  # (K, dof), what they cost
    seconds: float  # between two way points
    last_leg: int  # the way point at which it begins

    @property
    def steps(self) -> int:
        """How many time steps it takes."""
        return (len(self.joints) - 1) * WAYPOINT_STEPS

    def since(self, waypoint: int) -> "JointWay":
        """What is left of it from a way point on."""
        if not waypoint:
            return self
        rest = (self.joints[waypoint:], self.speeds[waypoint:], self.torques[waypoint:])
        return JointWay(*rest, self.seconds, max(0, self.last_leg - waypoint))

    def command_at(self, step: int, lead: FloatArray, stiffness: FloatArray) -> FloatArray:
        """The joint positions (dof,) to command for a time step. Ahead by what damping (``lead``, s) and inertia cost
        the arm keeps to its path; else it would swing out to the side."""
        row, beyond = divmod(step, WAYPOINT_STEPS)
        if not beyond:
            return self.joints[row] + self.speeds[row] * lead + self.torques[row] / stiffness
        ahead = self.speeds[row : row + 2] * lead + self.torques[row : row + 2] / stiffness
        share = beyond / WAYPOINT_STEPS
        (start, end), (leaving, arriving) = self.joints[row : row + 2], self.speeds[row : row + 2] * self.seconds
        between = joint_paths.between_waypoints(start, end, leaving, arriving, share)
        return between + ahead[0] + share * (ahead[1] - ahead[0])


def pace_legs(legs: Sequence[FloatArray], arm: Arm, timestep: float, spacing: int = WAYPOINT_STEPS) -> JointWay:
    """Legs one after the other, each way points (K, dof) or, with a ``spacing`` of 1, one row a time step (s), as slow
    as the joints' speeds allow."""
    if spacing != WAYPOINT_STEPS:
        legs = [leg[[*range(0, len(leg) - 1, WAYPOINT_STEPS // spacing), -1]] for leg in legs]
    seconds, limits = WAYPOINT_STEPS * timestep, _TOP_SPEED * arm.joint_speed_limits
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
