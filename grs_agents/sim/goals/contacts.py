"""Overlaps between objects before they settle, and support forces on them at rest."""

from itertools import combinations, product
from typing import Final

import numpy as np

from grs_agents.base import Frozen
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import GRAVITY
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.footprints import Prism, signed_outline_gaps

_POINT: Final = np.zeros((1, 2))
_AWAKE: Final = 50
"""Time steps (0.2 s) until contact forces have settled after waking all bodies."""
_MEASURED: Final = 10
"""Last of these steps, over which forces are averaged: those of boxes on a table jump from step to step."""
_LEVEL: Final = 0.7
"""Least sine of the elevation of a contact normal for the contact to carry from below: 45 degrees."""
_ON_TABLE: Final = 0.01
"""Greatest height of the underside of an object that stands on the table or on a mark, metres."""


class Overlap(Frozen):
    """Two interpenetrating objects."""

    first: int  # ids
    second: int
    depth: float  # metres


class Support(Frozen):
    """Support forces of the table and of other objects on an object."""

    object: int
    # upward force of nearly level contacts, over its weight; less than 1 where steep walls carry the rest
    carried: float
    squeeze: float  # sum of sideways forces over its weight and that of its load; large for a wedged object


def measure_overlaps(table: TabletopSim) -> tuple[Overlap, ...]:
    """Every pair of interpenetrating objects; the table and the robot do not count.

    Pairs that MuJoCo does not collide count by their upright prisms: fixed objects, and bystanders on marks, which
    are to be free.
    """
    physics = table.physics
    owners, depths = physics.world.owner_of_geom, dict[tuple[int, int], float]()
    contacts = physics.data.contact
    overlaps = [
        (int(first), int(second), -float(distance))
        for (first, second), distance in zip(owners[contacts.geom], contacts.dist, strict=True)
    ]
    prisms = table.collider_prisms()
    fixed = [prism for prism in prisms if not table.is_object_movable(prism.owner)]
    for first, second in combinations(fixed, 2):
        upwards = min(first.high, second.high) - max(first.low, second.low)
        if first.owner != second.owner and upwards > 0:  # most are parts of one bowl or tray
            overlaps.append((first.owner, second.owner, min(upwards, _horizontal_overlap_depth(first, second))))
    marks = [table.object_prism(item.id) for item in table.objects if not table.object_model(item.id).colliders]
    bystanders = {item.id for item in table.objects if item.role == "bystander"}
    standing = [prism for prism in prisms if prism.owner in bystanders and prism.low < _ON_TABLE]
    for mark, prism in product(marks, standing):
        overlaps.append((mark.owner, prism.owner, _horizontal_overlap_depth(mark, prism)))
    for first, second, depth in overlaps:
        if first != second and min(first, second) >= 0 and depth > 0:
            key = (min(first, second), max(first, second))
            depths[key] = max(depths.get(key, 0.0), depth)
    return tuple(Overlap(first=first, second=second, depth=depth) for (first, second), depth in depths.items())


def _horizontal_overlap_depth(first: Prism, second: Prism) -> float:
    return -float(signed_outline_gaps(first.outline, second.outline, _POINT)[0])


def measure_supports(table: TabletopSim) -> tuple[Support, ...]:
    """Support of each loose object of the task, from contact forces in a copy of the scene with all bodies awake."""
    physics = table.physics
    model, world = physics.model, physics.world
    data, force, owners = mujoco.MjData(model), np.empty(6), world.owner_of_geom
    for name in ("qpos", "act", "eq_active", "qacc_warmstart"):
        getattr(data, name)[:] = getattr(physics.data, name)
    flags, sleep = model.opt.enableflags, int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.opt.enableflags = flags & ~sleep
    mine = [number for number in world.addresses if table.object_by_id(number).role == "task"]
    try:
        physics.budget.spend_steps(_AWAKE)
        mujoco.mj_step(model, data, _AWAKE - _MEASURED)
        sums = np.zeros((max(mine, default=0) + 1, 3))  # upward, upward by level contacts, sideways; N
        for _ in range(_MEASURED):
            mujoco.mj_step(model, data)
            held = owners[data.contact.geom]
            for index in np.flatnonzero(((held >= 0) & (held < len(sums))).any(axis=1)).tolist():
                contact = data.contact[index]
                mujoco.mj_contactForce(model, data, index, force)
                frame = contact.frame.reshape(3, 3)
                x, y, z = force[:3] @ frame  # on the second geom
                level = abs(frame[0, 2]) >= _LEVEL
                for geom, sign in ((contact.geom[0], -1.0), (contact.geom[1], 1.0)):
                    owner = int(owners[geom])
                    if 0 <= owner < len(sums):
                        lift = max(0.0, sign * z)
                        sums[owner] += (lift, lift * level, float(np.hypot(x, y)))
    finally:
        model.opt.enableflags = flags
    supports: list[Support] = []
    for number in mine:
        up, level, sideways = sums[number] / _MEASURED
        weight = physics.object_mass(number) * GRAVITY
        supports.append(
            Support(object=number, carried=round(level / weight, 3), squeeze=round(sideways / max(weight, up), 3))
        )
    return tuple(supports)
