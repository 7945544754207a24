"""The arm as MuJoCo bodies: a UR5e of our own capsules with a suction cup, driven by position actuators."""

from typing import Any, Final

import numpy as np

from grs_agents.sim.engine import mujoco
from grs_agents.sim.kinematics import A2, A3, D1, D4, D5, D6, LINKS, TOOL_LENGTH

CUP_RADIUS: Final = 0.010
HOME: Final = (0.35, 0.0, 0.42)
"""Where the tip waits, metres."""
LINK_NAMES: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
# Published link masses, and the capsule of each link in its own frame: from, to, radius.
_MASSES: Final = (3.761, 8.058, 2.846, 1.37, 1.3, 0.365)
CAPSULES: Final = (
    ((0.0, 0.0, 0.02), (0.0, 0.0, D1), 0.060),
    ((0.0, 0.0, 0.138), (A2, 0.0, 0.138), 0.054),
    ((0.0, 0.0, 0.007), (A3, 0.0, 0.007), 0.042),
    ((0.0, 0.0, 0.02), (0.0, 0.0, D4 - 0.02), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D5), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D6 - 0.02), 0.034),
)
_STIFFNESS: Final = (6000.0, 6000.0, 4000.0, 2000.0, 2000.0, 1000.0)
_TORQUE: Final = (300.0, 300.0, 200.0, 60.0, 60.0, 60.0)
ROBOT_CONTYPE: Final = 2
"""Robot geoms meet geoms whose ``conaffinity`` has this bit: objects, not the table and not the robot."""


def add_robot(spec: Any) -> None:
    """Add the arm to ``spec``: bodies and joints of ``LINK_NAMES``, body and geom ``cup``, site ``tip``."""
    parent: Any = spec.worldbody
    offset, roll = (0.0, 0.0, 0.0), 0.0
    for index, name in enumerate(LINK_NAMES):
        quaternion = (float(np.cos(roll / 2)), float(np.sin(roll / 2)), 0.0, 0.0)
        body = parent.add_body(name=name, pos=offset, quat=quaternion, gravcomp=1.0)
        body.add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1), armature=0.1,
            range=(-2 * np.pi, 2 * np.pi), limited=True,
        )  # fmt: skip
        start, end, radius = CAPSULES[index]
        body.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*start, *end), size=(radius, 0, 0),
            mass=_MASSES[index], rgba=(0.75, 0.77, 0.8, 1.0), group=1,
            contype=ROBOT_CONTYPE if index >= 2 else 0, conaffinity=0,
        )  # fmt: skip
        a, d, roll = LINKS[index]
        offset = (a, 0.0, d)
        parent = body
        _add_actuator(spec, name, _STIFFNESS[index], _TORQUE[index])
    _add_tool(parent, offset)


def _add_actuator(spec: Any, joint: str, stiffness: float, torque: float) -> None:
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=stiffness, dampratio=1.0)
    actuator.forcelimited = True
    actuator.forcerange = (-torque, torque)


def _add_tool(flange: Any, offset: tuple[float, float, float]) -> None:
    cup = flange.add_body(name="cup", pos=offset, gravcomp=1.0)
    shared: dict[str, Any] = {"contype": ROBOT_CONTYPE, "conaffinity": 0, "group": 1}
    cup.add_geom(
        name="tool", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(0.008, 0, 0), mass=0.1,
        fromto=(0, 0, 0.0, 0, 0, TOOL_LENGTH - 0.025), rgba=(0.2, 0.2, 0.22, 1.0), **shared,
    )  # fmt: skip
    cup.add_geom(
        name="cup", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(CUP_RADIUS, 0.01, 0), mass=0.05,
        pos=(0, 0, TOOL_LENGTH - 0.01), rgba=(0.1, 0.1, 0.1, 1.0), **shared,
    )  # fmt: skip
    cup.add_site(name="tip", pos=(0, 0, TOOL_LENGTH), size=(0.003, 0.003, 0.003))
