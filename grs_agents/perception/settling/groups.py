"""Settle a scene in groups of objects that cannot meet, each in a simulation of its own.

A change of an object concerns its group alone: the others need not be simulated again. Objects that nobody changed are
at rest already, so drift is of the changed objects, and accepted.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.perception.settling.settling import (
    PlacedObject,
    RestPose,
    RestState,
    is_over_table,
    settle_objects,
    to_instance_objects,
)
from grs_agents.sim.world.footprints import Prism, convex_hull, least_outline_gaps, object_prism_at_pose

APART: Final = 0.005
"""Gap (m) between objects of different groups on their way to rest."""


class GroupSettler:
    """Settles the states of a scene one after another; groups of the last state are not simulated again."""

    def __init__(self) -> None:
        """Begin without a state."""
        self._rests: dict[tuple[tuple[PlacedObject, int], ...], RestState] = {}  # by objects and times of their files

    def settle(self, objects: Sequence[PlacedObject], library: Library) -> RestState:
        """The scene at rest, a function of its objects alone; groups that meet on their way to rest are one.

        Raises:
            SimulationError: MuJoCo rejects the scene.
        """
        here = [number for number, placed in enumerate(objects) if is_over_table(placed)]
        keys = [(it, library.asset_path(it.asset).stat().st_mtime_ns) for it in (objects[number] for number in here)]
        ways = [_prism(it, it.pose, library) for it, _ in keys]
        known, groups = dict(self._rests), _join_groups(np.arange(len(here)), ways)
        self._rests.clear()
        while True:
            rests, placed = list[RestState](), list[RestPose | None]([None] * len(objects))
            for group in np.unique(groups):
                members = np.flatnonzero(groups == group)
                key = tuple(keys[member] for member in members)
                if key not in known:
                    known[key] = settle_objects([it for it, _ in key], library, accept_drift=True)
                self._rests[key] = known[key]
                rests.append(known[key])
                for member, end in zip(members, known[key].placed, strict=True):
                    placed[here[member]] = end
                    if end is not None:
                        ways[member] = _hull(ways[member], _prism(keys[member][0], end.pose, library))
            joined = _join_groups(groups, ways)
            if np.array_equal(joined, groups):
                break
            groups = joined
        return RestState(
            tuple(placed),
            found=max((rest.found for rest in rests), default=0.0),
            penetration=max((rest.penetration for rest in rests), default=0.0),
            still=all(rest.still for rest in rests),
        )


def _prism(placed: PlacedObject, pose: Pose, library: Library) -> Prism:
    """The prism around an object at a pose of its centre."""
    (item,) = to_instance_objects([replace(placed, pose=pose)], library)
    return object_prism_at_pose(library.load_object_model(item.asset), item.pose)


def _hull(first: Prism, second: Prism) -> Prism:
    """The prism around two."""
    outline = convex_hull(np.concatenate([first.outline, second.outline]))
    return Prism(outline, min(first.low, second.low), max(first.high, second.high))


def _join_groups(groups: npt.NDArray[np.int_], ways: Sequence[Prism]) -> npt.NDArray[np.int_]:
    """Join groups (N,) whose members have prisms nearer than `APART`."""
    joined = groups.copy()
    for first, second in combinations(range(len(ways)), 2):
        left, right = ways[first], ways[second]
        if joined[first] == joined[second] or max(left.low, right.low) > min(left.high, right.high) + APART:
            continue
        if least_outline_gaps(left.outline, [right], np.zeros((1, 2)))[0] < APART:
            joined[joined == joined[second]] = joined[first]
    return joined
