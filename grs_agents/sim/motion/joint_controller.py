"""Joint position control of the arm at a control rate, with velocity feed-forward, and its hand."""

from typing import Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.motion.grasp import find_object_in_seal
from grs_agents.sim.world.fingers import Fingers
from grs_agents.sim.world.grip import WATCHED
from grs_agents.sim.world.physics import Physics

CONTROL_RATE: Final = 25.0
"""Hz: ten steps of 4 ms."""

_LOWEST: Final = -0.002
"""Lowest height of the tip, metres: the overshoot allowed for an arm that comes down on the table."""


class JointController:
    """Drives the arm through joint positions; suction grasps the object under a sealed cup, fingers what they close on.

    The joint positions that an expert's episode reached a period later, as targets, repeat the episode, if suction is
    on about eight periods early (the cup grasps on contact), and the target of the period in which the expert grasped
    is the grasp itself: at the end of that period the arm has risen again.

    Attributes:
        reference: joint positions (dof,) commanded for the end of the period, rad (slides: m).
        tip: position (3,) of the tip there, m, and its rotation (3, 3) from the tool straight down.
        blocked: the last target was refused.
    """

    def __init__(self, physics: Physics, rate: float = CONTROL_RATE) -> None:
        """``rate`` (Hz) must divide the physics' steps a second, else ``SimulationError``."""
        steps = 1.0 / (rate * physics.timestep)
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            message = f"{rate:g} Hz is not a whole number of physics steps of {1000 * physics.timestep:g} ms"
            raise SimulationError(message, f"use a rate that divides {1 / physics.timestep:g} Hz, e.g. 25 or 50")
        self.physics, self.rate, self.steps = physics, rate, round(steps)
        self.low, self.high = physics.arm.lower_joint_limits, physics.arm.upper_joint_limits
        self.farthest: FloatArray = physics.arm.joint_speed_limits / rate  # (dof,) rad or m a period
        self._fingers = physics.grip if isinstance(physics.grip, Fingers) else None
        self.reset()

    def reset(self) -> None:
        """Take the present joint positions as the reference, at rest."""
        self.reference: FloatArray = self.physics.joint_positions
        self.tip = self.physics.arm.tip_pose(self.reference)
        self.blocked = False

    def apply(self, target: FloatArray, suction: float) -> None:
        """Simulate a control period; the hand holds for ``suction`` above 0, else fingers open to that share, -1..0.

        The arm moves evenly from the reference to ``target`` (dof,; rad or m), clipped to its joint limits and speeds,
        and not at all if it would meet the table or itself (``blocked``). The position reached is the next reference.
        """
        physics = self.physics
        way = np.minimum(np.maximum(target, self.low), self.high) - self.reference  # np.clip takes twice as long
        way /= max(1.0, *(np.abs(way) / self.farthest).tolist())
        step = self.reference + way
        tip = physics.arm.tip_pose(step)
        self.blocked = float(tip[0][2]) < _LOWEST or physics.arm.find_collision_at_joints(step) is not None
        if self.blocked:
            way[:] = 0.0
        else:
            self.reference, self.tip = step, tip
        # A speed that jumps from period to period would shake off the held object.
        command = physics.compensate_joint_damping(self.reference, way * self.rate)
        left = self.steps
        if self._fingers is not None:
            while left:
                part = min(left, WATCHED)
                self._fingers.move_towards(suction, part)
                physics.lead_arm(command, part, within=left)
                left -= part
            return
        sucks, cup = suction > 0, physics.cup
        if not sucks and cup.held is not None:
            cup.release()
        while left:
            if sucks and cup.held is None:  # a slipped object is grasped again at once
                left -= physics.lead_arm(command, left, left, self._grasp_if_sealed)
            else:
                left -= physics.lead_arm(command, min(left, cup.due), left)

    def _grasp_if_sealed(self) -> bool:
        """Grasp the object that the cup has sealed on, if any."""
        if (sealed := find_object_in_seal(self.physics)) is None:
            return False
        self.physics.cup.grasp(sealed)
        return True
