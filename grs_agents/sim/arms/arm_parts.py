"""Arms as MuJoCo bodies: serial chains of capsules with position actuators, and the tool at the tip: the suction cup,
or for pushing tasks the spatula, a flat upright blade."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.mujoco_import import mujoco

CUP_RADIUS: Final = 0.010
_VACUUM: Final = 15.0 / CUP_RADIUS**2
"""Holding force per squared radius, N/m^2: a vacuum of 60 kPa on a disk of 20 mm (18.8 N), times 0.8, is 15 N."""
TOOL_LENGTH: Final = 0.15
"""From the flange to the tip of the suction cup, metres."""
ROBOT_CONTYPE: Final = 2
"""Robot geoms meet geoms whose ``conaffinity`` has this bit: objects, not the table and not the robot."""
Capsule = tuple[Vec3, Vec3, float]
"""From, to, radius, metres, in the frame of the link."""


@dataclass(frozen=True)
class Nozzle:
    """A round suction nozzle.

    Attributes:
        radius: of its body, metres.
        lip: radius of its sealing lip, metres.
    """

    radius: float
    lip: float

    @property
    def holding_force(self) -> float:
        """Force that it holds, newtons."""
        return _VACUUM * self.radius**2

    @property
    def peeling_moment(self) -> float:
        """Moment that peels its lip off, newton metres: it tips a disk held by that force over its edge."""
        return self.holding_force * self.radius

    def is_wider_than(self, size: Sequence[float]) -> bool:
        """Whether its lip fits on no face of a box of ``size`` (3,), metres."""
        return sorted(size)[1] < 2 * self.lip


CUP: Final = Nozzle(CUP_RADIUS, 0.008)
NARROW: Final = Nozzle(0.004, 0.0028)
"""For objects under 16 mm: on a cube of 1 cm its body stays 1 mm from the edges."""


@dataclass(frozen=True)
class Link:
    """A moving link of a serial arm, with its hinge about the z axis."""

    name: str
    position: Vec3  # metres, in the frame of the link before
    roll: float  # radians about x, in the frame of the link before
    limits: tuple[float, float]  # lowest and highest joint angle, radians
    torque: float  # greatest the joint exerts, N m
    stiffness: float  # of the position actuator, N m/rad
    mass: float  # kg
    center: Vec3  # of mass, metres, frame of the link
    # about the centre of mass, (xx, yy, zz, xy, xz, yz), kg m^2
    inertia: tuple[float, float, float, float, float, float]
    capsules: tuple[Capsule, ...]


def add_link_chain(spec: Any, links: Sequence[Link], flange: Vec3) -> None:
    """Add a chain of links from the origin on, and the suction cup at ``flange`` (m) of the last link."""
    parent: Any = spec.worldbody
    for link in links:
        body = parent.add_body(name=link.name, pos=link.position, quat=quaternion_about_x(link.roll), gravcomp=1.0)
        body.explicitinertial = True
        body.mass, body.ipos, body.fullinertia = link.mass, link.center, link.inertia
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=link.name, type=hinge, axis=(0, 0, 1), armature=0.1, range=link.limits, limited=True)
        for index, (start, end, radius) in enumerate(link.capsules):
            body.add_geom(
                name=f"{link.name}_{index}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=(*start, *end),
                size=(radius, 0, 0),
                rgba=(0.75, 0.77, 0.8, 1.0),
                group=1,
                contype=ROBOT_CONTYPE,
                conaffinity=0,
            )
        add_position_actuator(spec, link.name, link.stiffness, link.torque)
        parent = body
    add_suction_cup(parent, flange)


def quaternion_about_x(angle: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a rotation about x."""
    return (float(np.cos(angle / 2)), float(np.sin(angle / 2)), 0.0, 0.0)


def add_position_actuator(spec: Any, joint: str, stiffness: float, torque: float) -> None:
    """Drive a joint to a position, critically damped, with at most ``torque`` (N m, or N of a slide)."""
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=stiffness, dampratio=1.0)
    actuator.forcelimited = True
    actuator.forcerange = (-torque, torque)


def add_suction_cup(flange: Any, position: Sequence[float], quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> None:
    """Fix the suction cup to a body: body and geom ``cup``, site ``tip``; it points along z of the given frame."""
    cup = flange.add_body(name="cup", pos=position, quat=quaternion, gravcomp=1.0)
    shared: dict[str, Any] = {"contype": ROBOT_CONTYPE, "conaffinity": 0, "group": 1}
    size = (0.008, 0, 0)
    fromto = (0, 0, 0.0, 0, 0, TOOL_LENGTH - 0.025)
    rgba = (0.2, 0.2, 0.22, 1.0)
    cup.add_geom(
        name="tool", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=size, mass=0.1, fromto=fromto, rgba=rgba, **shared
    )
    cup.add_geom(
        name="cup",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(CUP_RADIUS, 0.01, 0),
        mass=0.05,
        pos=(0, 0, TOOL_LENGTH - 0.01),
        rgba=(0.1, 0.1, 0.1, 1.0),
        **shared,
    )
    cup.add_site(name="tip", pos=(0, 0, TOOL_LENGTH), size=(0.003, 0.003, 0.003))


DOWN: Final = np.diag([1.0, -1.0, -1.0])
"""Rotation of the tool pointing straight down, with zero yaw."""


BLADE_WIDTH: Final = 0.10
BLADE_HEIGHT: Final = 0.115
BLADE_THICKNESS: Final = 0.005
BLADE_BELOW_TIP: Final = 0.003
"""Depth of the blade below the tip, metres: a tip at the published 5 mm drags the edge 2 mm above the table."""


def replace_cup_with_spatula(spec: Any) -> None:
    """Replace the suction cup in ``spec`` by a blade across the tool's x axis, its edge below the tip."""
    length = float(spec.site("tip").pos[2])
    blade, tool = spec.geom("cup"), spec.geom("tool")
    blade.type = mujoco.mjtGeom.mjGEOM_BOX
    blade.size = (BLADE_THICKNESS / 2, BLADE_WIDTH / 2, BLADE_HEIGHT / 2)
    blade.pos = (0.0, 0.0, length + BLADE_BELOW_TIP - BLADE_HEIGHT / 2)
    blade.rgba = (0.8, 0.8, 0.8, 1.0)
    blade.solref = (0.02, 1.0)
    tool.fromto = (0.0, 0.0, 0.0, 0.0, 0.0, length - BLADE_HEIGHT)
