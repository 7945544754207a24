"""Ties between objects in a MuJoCo model: joints of ropes, and what is fixed to another thing."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from grs_agents.engine import mujoco
from grs_agents.sim.instance.instance import InstanceTie

LARGEST_BEAD: Final = 0.05
"""What is larger and tied at a point is no bead of a rope: the cup must seal on it as on any other thing, metres."""
_BEAD_ARMATURE: Final = 4e-6
_BEAD_DAMPING: Final = 6e-5
"""Of what is tied at a point: added to its inertia (kg m^2), and against its turning (N m s/rad)."""


def limp_of(ties: Sequence[InstanceTie]) -> frozenset[int]:
    """Ids of what a point ties to another."""
    return frozenset(number for tie in ties if tie.kind == "point" for number in (tie.parent, tie.child))


def add_ties(spec: Any, ties: Sequence[InstanceTie], timestep: float) -> None:
    """One equality of two sites for each tie, between the bodies called ``object_<id>``."""
    for index, tie in enumerate(ties):
        _add_tie(spec, tie, index, timestep)


def _add_tie(spec: Any, tie: InstanceTie, index: int, timestep: float) -> None:
    ends = ((tie.parent, tie.parent_frame), (tie.child, tie.child_frame))
    names: list[str] = []
    for number, (position, (x, y, z, w)) in ends:
        names.append(f"tie_{index}_{number}")
        spec.body(f"object_{number}").add_site(name=names[-1], pos=position, quat=(w, x, y, z))
    kind = mujoco.mjtEq.mjEQ_CONNECT if tie.kind == "point" else mujoco.mjtEq.mjEQ_WELD
    equality = spec.add_equality(
        name=f"tie_{index}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=names[0], name2=names[1]
    )
    equality.solref = (2 * timestep, 1.0)
    if tie.kind == "point":
        _make_bead(spec, tie)


def _make_bead(spec: Any, tie: InstanceTie) -> None:
    """Small things on a joint are slow to turn: it keeps the joint steady, and balls from rolling off as marbles do."""
    for number in (tie.parent, tie.child):
        for joint in spec.body(f"object_{number}").joints:
            joint.armature, joint.damping = _BEAD_ARMATURE, np.full(3, _BEAD_DAMPING)
        for geom in spec.body(f"object_{number}").geoms:
            geom.condim = 3
