"""Arms as MuJoCo bodies: serial chains of capsules with position actuators, and a hand at the flange."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import ROBOT_CONTYPE, Hand

Capsule = tuple[Vec3, Vec3, float]
"""From, to, radius, metres, in the frame of the link."""


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


def add_link_chain(spec: Any, links: Sequence[Link], flange: Vec3, hand: Hand, moving: bool = True) -> None:
    """Add a chain of links from the origin on, and a hand, see ``Hand.add_to``, at ``flange`` (m) of the last link."""
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
    hand.add_to(spec, parent, flange, moving=moving)


def quaternion_about_x(angle: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a rotation about x."""
    return (float(np.cos(angle / 2)), float(np.sin(angle / 2)), 0.0, 0.0)


def add_position_actuator(spec: Any, joint: str, stiffness: float, torque: float) -> None:
    """Drive a joint to a position, critically damped, with at most ``torque`` (N m, or N of a slide)."""
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=stiffness, dampratio=1.0)
    actuator.forcelimited = True
    actuator.forcerange = (-torque, torque)


DOWN: Final = np.diag([1.0, -1.0, -1.0])
"""Rotation of the tool pointing straight down, with zero yaw."""
