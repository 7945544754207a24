"""Drives the arm at a control rate: joint positions with velocity feed-forward, and suction."""

from typing import Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.motion.grasp import find_object_in_seal
from grs_agents.sim.world.physics import Physics

CONTROL_RATE: Final = 25.0
"""Hz: ten steps of 4 ms."""

_LOWEST: Final = -0.002
"""Of the tip, metres: what an arm that comes down on the table may overshoot by."""


class JointController:
    """Drives the arm through joint positions; suction that is on takes what the cup seals on, off lets go of it.

    What an episode of the expert reached one period later, given as targets, does the episode again, if suction is on
    some eight periods early (the cup takes hold as soon as it touches), and the target of the period in which the
    expert took hold is where it did: at the period's end the arm has risen again.
    """

    def __init__(self, physics: Physics, rate: float = CONTROL_RATE) -> None:
        """``rate`` (Hz) must divide the physics' steps a second, else ``SimulationError``."""
        steps = 1.0 / (rate * physics.timestep)
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            found = f"{rate:g} Hz is not a whole number of physics steps of {1000 * physics.timestep:g} ms"
            raise SimulationError(found, f"use a rate that divides {1 / physics.timestep:g} Hz, e.g. 25 or 50")
        self.physics, self.rate, self.steps = physics, rate, round(steps)
        self.low, self.high = physics.arm.lower_joint_limits, physics.arm.upper_joint_limits
        self.farthest: FloatArray = physics.arm.joint_speed_limits / rate  # (dof,) rad or m a period
        self.reset()

    def reset(self) -> None:
        """Take up the present joint positions as the reference, at rest."""
        self.reference: FloatArray = self.physics.joint_positions
        self._speed: FloatArray = np.zeros(self.physics.dof)
        self.blocked = False  # the last target was not followed

    def apply(self, target: FloatArray, suction: bool) -> None:
        """Simulate one control period.

        The arm is led evenly from the reference to ``target`` (dof,; rad or m), as far as its joints' limits and speeds
        allow, and not where it would meet the table or itself (``blocked``). Where it was led to is the next reference.
        """
        physics = self.physics
        way = np.clip(target, self.low, self.high) - self.reference
        way /= max(1.0, float((np.abs(way) / self.farthest).max()))
        self.blocked = self._would_collide(self.reference + way)
        if self.blocked:
            way[:] = 0.0
        # A speed that jumped from period to period would shake off what is held.
        speed = way * self.rate
        self.reference, self._speed = self.reference + way, speed
        (command,) = physics.compensate_joint_damping(self.reference[None], self._speed)
        if not suction and physics.held_object_id is not None:
            physics.cup.release()
        left = self.steps
        while left:
            seeking = suction and physics.held_object_id is None
            part = 1 if seeking else min(left, physics.cup.due)  # what slips off the cup is taken again at once
            physics.lead_arm(command, part, within=left)
            left -= part
            if seeking and (found := find_object_in_seal(physics)) is not None:
                physics.cup.grasp(found)

    def _would_collide(self, joints: FloatArray) -> bool:
        arm = self.physics.arm
        return arm.find_collision_at_joints(joints) is not None or float(arm.tip_pose(joints)[0][2]) < _LOWEST
