"""What MuJoCo's contacts say of a scene: what reaches into what before it settles, and how everything is held up."""

from collections.abc import Iterator
from itertools import combinations, product
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Frozen
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.world.footprints import Prism, signed_outline_gaps
from grs_agents.sim.world.tabletop import Tabletop

_POINT: Final = np.zeros((1, 2))
_AWAKE: Final = 50
"""Time steps (0.2 s) in which contact forces come to rest once everything is woken."""
_MEASURED: Final = 10
"""The last of them, over which forces are averaged: those of boxes on a table jump from step to step."""
_LEVEL: Final = 0.7
"""A contact carries from below where its normal rises at least so steeply, as the sine of the angle: 45 degrees."""


_ON_TABLE: Final = 0.01
"""What reaches lower than this (m) stands on the table, or on a mark there."""


class Overlap(Frozen):
    """Two objects that reach into each other."""

    first: int  # ids
    second: int
    depth: float  # metres


class Support(Frozen):
    """How the table and other objects hold one object up."""

    object: int
    # upward force of contacts that are nearly level, over its weight; less than 1 where steep walls carry the rest
    carried: float
    squeeze: float  # sideways forces, added up, over its weight and that of what it carries; large where it is wedged


def measure_overlaps(table: Tabletop) -> tuple[Overlap, ...]:
    """Every pair of objects that reach into each other as they stand; the table and the robot do not count.

    A bystander on a mark counts, as what the mark says is to be free.
    """
    physics = table.physics
    owners, depths = physics.world.owner_of_geom, dict[tuple[int, int], float]()
    contacts = physics.data.contact
    found = [
        (int(one), int(other), -float(distance))
        for (one, other), distance in zip(owners[contacts.geom], contacts.dist, strict=True)
    ]
    for one, other, depth in [*found, *_measure_noncolliding_overlaps(table)]:
        if one != other and min(one, other) >= 0 and depth > 0:
            key = (min(one, other), max(one, other))
            depths[key] = max(depths.get(key, 0.0), depth)
    return tuple(Overlap(first=one, second=other, depth=depth) for (one, other), depth in depths.items())


def _measure_noncolliding_overlaps(table: Tabletop) -> Iterator[tuple[int, int, float]]:
    """(id, id, metres) of what MuJoCo does not collide, by upright prisms: fixed things, and bystanders on marks."""
    fixed = [prism for prism in table.collider_prisms() if not table.is_object_movable(prism.owner)]
    for one, other in combinations(fixed, 2):
        upwards = min(one.high, other.high) - max(one.low, other.low)
        if one.owner != other.owner and upwards > 0:  # most are parts of one bowl or tray
            yield one.owner, other.owner, min(upwards, _horizontal_overlap_depth(one, other))
    marks = [item.id for item in table.objects if not table.object_model(item.id).colliders]
    for mark, prism in product(map(table.object_prism, marks), _bystander_prisms_on_table(table) if marks else ()):
        yield mark.owner, prism.owner, _horizontal_overlap_depth(mark, prism)


def _bystander_prisms_on_table(table: Tabletop) -> list[Prism]:
    numbers = {item.id for item in table.objects if item.role == "bystander"}
    return [prism for prism in table.collider_prisms() if prism.owner in numbers and prism.low < _ON_TABLE]


def _horizontal_overlap_depth(one: Prism, other: Prism) -> float:
    return -float(signed_outline_gaps(one.outline, other.outline, _POINT)[0])


def measure_supports(table: Tabletop) -> tuple[Support, ...]:
    """How each of the task's loose objects is held up, by the contact forces of a copy of the scene that is awake."""
    physics = table.physics
    model, world = physics.model, physics.world
    data = mujoco.MjData(model)
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
            _add_contact_forces(model, data, world.owner_of_geom, sums)
    finally:
        model.opt.enableflags = flags
    supports: list[Support] = []
    for number in mine:
        up, level, sideways = sums[number] / _MEASURED
        weight = physics.object_mass(number) * 9.81
        supports.append(
            Support(object=number, carried=round(level / weight, 3), squeeze=round(sideways / max(weight, up), 3))
        )
    return tuple(supports)


def _add_contact_forces(model: Any, data: Any, owners: npt.NDArray[np.int_], sums: FloatArray) -> None:
    """Add what contacts do to the objects whose ids are rows of ``sums``."""
    force, held = np.empty(6), owners[data.contact.geom]
    for index in np.flatnonzero(((held >= 0) & (held < len(sums))).any(axis=1)).tolist():
        contact = data.contact[index]
        mujoco.mj_contactForce(model, data, index, force)
        frame = contact.frame.reshape(3, 3)
        world = force[:3] @ frame  # on the second geom
        level = abs(frame[0, 2]) >= _LEVEL
        for geom, sign in ((contact.geom[0], -1.0), (contact.geom[1], 1.0)):
            owner = int(owners[geom])
            if 0 <= owner < len(sums):
                lift = max(0.0, sign * world[2])
                sums[owner] += (lift, lift * level, float(np.hypot(world[0], world[1])))
