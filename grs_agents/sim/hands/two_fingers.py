"""Parallel grippers: two pads that close on each other along y of the hand, by the makers' data sheets.

Their outlines are boxes of our own; fingers slide in parallel, also those that a linkage carries.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import GRAVITY, ROBOT_CONTYPE, Tool

FINGERS: Final = ("left_finger", "right_finger")
"""Names of the bodies and joints of the fingers, at +y and -y of the hand."""
PADS: Final = ("left_pad", "right_pad")
"""Names of the geoms that hold."""
PAD_FRICTION: Final = (1.5, 0.01, 1e-4)
"""Of rubber pads: sliding, torsional (m), rolling (m)."""
_STIFFNESS, _DAMPING, _ARMATURE = 4000.0, 200.0, 1.0
"""Of a finger's actuator (N/m), and of its joint (N s/m, kg): steady at time steps of 4 ms."""
_SOLREF, _SOLIMP = (0.008, 1.5), (0.95, 0.99, 0.001, 0.5, 2.0)
"""Of the pads: overdamped, with the shortest time constant, two time steps: with less a jolt drives the pads 2 mm into
what they hold."""
_LIGHT_FORCE, _FORCE_PER_MASS, _FIRM_FORCE, _HARD_FORCE = 10.0, 100.0, 40.0, 80.0
"""Gripping force of nothing (N), its growth (N/kg), a firm grip, and the hardest (N)."""
_UNDER_PALM: Final = 0.004
_DARK: Final = (0.16, 0.16, 0.18, 1.0)
_WHITE: Final = (0.9, 0.9, 0.91, 1.0)


@dataclass(frozen=True)
class Block:
    """A box of a hand: its middle and its half sizes, metres; of a finger relative to the inner face of its pad."""

    middle: Vec3
    half: Vec3
    color: tuple[float, float, float, float]


@dataclass(frozen=True)
class TwoFingerHand:
    """A parallel gripper.

    Attributes:
        name: configured name.
        maker: its name in messages.
        length: from the flange to the ends of the fingers, metres.
        stroke: greatest distance between the pads, metres.
        forces: least and greatest gripping force, newtons.
        speed: of a finger, m/s.
        payload: greatest mass that it holds by friction, kg.
        masses: of the body and of a finger, kg.
        pad: half sizes of a pad along x, y and z, metres; its end is the end of the finger.
        palm: boxes of the body, frame of the flange.
        finger: boxes of the finger behind its pad, for the finger at +y.
    """

    name: str
    maker: str
    length: float
    stroke: float
    forces: tuple[float, float]
    speed: float
    payload: float
    masses: tuple[float, float]
    pad: Vec3
    palm: tuple[Block, ...]
    finger: tuple[Block, ...]

    @property
    def tool(self) -> Tool:
        """Working principle."""
        return "fingers"

    @property
    def body(self) -> str:
        """Name of the body at the flange."""
        return "hand"

    @property
    def depth(self) -> float:
        """Greatest depth of an object between the fingers, metres."""
        return self.length - max(block.middle[2] + block.half[2] for block in self.palm) - _UNDER_PALM

    def gripping_force(self, mass: float, lever: float = 0.0) -> float:
        """Force (N) to hold a mass (kg) whose centre is ``lever`` (m) beside the pads.

        Light objects are held gently, so that they do not sink into the pads; what turns between them is held harder.
        """
        force = min(max(_LIGHT_FORCE + _FORCE_PER_MASS * mass, self.forces[0]), _FIRM_FORCE)
        force += GRAVITY * mass * lever / (2 * PAD_FRICTION[0] * self.pad[0])
        return min(force, self.forces[1], _HARD_FORCE)

    def lowest_points(self, axes: FloatArray, widths: FloatArray | float) -> FloatArray:
        """Heights (...,) of the lowest corner of the hand over its tip, with axes (..., 3, 3) and widths (...,)
        between the pads, metres."""
        slopes, upright = np.abs(axes[..., 2, :]), axes[..., 2, 2]
        x, y, z = self.pad
        lows = [-z * upright - slopes @ (x, 2 * y, z) - slopes[..., 1] * widths / 2]
        lows += [(block.middle[2] - self.length) * upright - slopes @ block.half for block in self.palm]
        return np.minimum.reduce(lows)

    def add_to(
        self,
        spec: Any,
        flange: Any,
        position: Sequence[float],
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        moving: bool = True,
    ) -> None:
        """Add the body ``hand``, its fingers with a slide and an actuator each, and their coupling."""
        hand = flange.add_body(name=self.body, pos=position, quat=quaternion, gravcomp=1.0)
        for block in self.palm:
            _add_block(hand, block, mass=self.masses[0] / len(self.palm))
        hand.add_site(name="tip", pos=(0, 0, self.length), size=(0.003, 0.003, 0.003))
        _, thickness, height = self.pad
        for name, pad, side in zip(FINGERS, PADS, (1.0, -1.0), strict=True):
            open_at = (0.0, 0.0 if moving else side * self.stroke / 2, 0.0)
            finger = hand.add_body(name=name, pos=open_at, gravcomp=1.0)
            if moving:
                finger.add_joint(
                    name=name,
                    type=mujoco.mjtJoint.mjJNT_SLIDE,
                    axis=(0, side, 0),
                    range=(0.0, self.stroke / 2),
                    limited=True,
                    armature=_ARMATURE,
                    damping=_DAMPING,
                )
                actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
                actuator.set_to_position(kp=_STIFFNESS, dampratio=1.0)
                actuator.forcelimited, actuator.forcerange = True, (-self.forces[1], self.forces[1])
                actuator.ctrllimited, actuator.ctrlrange = True, (0.0, self.stroke / 2)
            for block in self.finger:
                (x, y, z), rest = block.middle, self.masses[1] / (len(self.finger) + 1)
                _add_block(finger, Block((x, side * y, z), block.half, block.color), mass=rest)
            middle = (0.0, side * thickness, self.length - height)
            _add_block(
                finger,
                Block(middle, self.pad, _DARK),
                name=pad,
                mass=self.masses[1] / (len(self.finger) + 1),
                condim=4,
                friction=PAD_FRICTION,
                solref=_SOLREF,
                solimp=_SOLIMP,
                priority=1,
            )
        if moving:
            coupling = spec.add_equality(
                name="fingers", type=mujoco.mjtEq.mjEQ_JOINT, name1=FINGERS[0], name2=FINGERS[1]
            )
            coupling.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
            coupling.solref = (2 * float(spec.option.timestep), 1.0)


def _add_block(body: Any, block: Block, **more: Any) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=block.middle,
        size=block.half,
        rgba=block.color,
        contype=ROBOT_CONTYPE,
        conaffinity=0,
        group=1,
        **more,
    )


FRANKA_HAND: Final = TwoFingerHand(
    name="franka_hand",
    maker="Franka Hand",
    length=0.1124,
    stroke=0.080,
    forces=(5.0, 70.0),
    speed=0.05,
    payload=3.0,
    masses=(0.70, 0.015),
    pad=(0.00875, 0.0076, 0.00925),
    palm=(
        Block((0.0, 0.0, 0.0100), (0.0315, 0.0500, 0.0100), _WHITE),
        Block((0.0, 0.0, 0.0400), (0.0315, 0.1020, 0.0200), _WHITE),
        Block((0.0, 0.0, 0.0620), (0.0140, 0.0950, 0.0020), _DARK),
    ),
    finger=(
        Block((0.0, 0.0185, 0.0755), (0.0110, 0.0075, 0.0115), _WHITE),
        Block((0.0, 0.0130, 0.0905), (0.00875, 0.0070, 0.0045), _WHITE),
    ),
)
"""Franka Emika's hand: stroke 80 mm, 70 N continuously (140 N at most), 0.73 kg; outline of the maker's description."""
ROBOTIQ_2F85: Final = TwoFingerHand(
    name="robotiq_2f85",
    maker="Robotiq 2F-85",
    length=0.1628,
    stroke=0.085,
    forces=(20.0, 235.0),
    speed=0.075,
    payload=5.0,
    masses=(0.80, 0.06),
    pad=(0.0110, 0.0060, 0.0250),
    palm=(
        Block((0.0, 0.0, 0.0470), (0.0375, 0.0375, 0.0470), _DARK),
        Block((0.0, 0.0, 0.1000), (0.0135, 0.0700, 0.0065), (0.45, 0.46, 0.48, 1.0)),
    ),
    finger=(Block((0.0, 0.0110, 0.1090), (0.0100, 0.0110, 0.0050), (0.45, 0.46, 0.48, 1.0)),),
)
"""Robotiq's 2F-85: stroke 85 mm, 20 to 235 N, 0.925 kg, 5 kg by friction; length with closed fingers, 162.8 mm."""
