"""A snapshot of the scene for planning: outlines, names, and what stands where."""

import copy
import math
from collections.abc import Mapping, Sequence

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.geometry import transforms
from grs_agents.library import ObjectModel
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.world.collision_volumes import Volume
from grs_agents.sim.world.footprints import Prism, footprint, inside_margin, prisms, turn
from grs_agents.sim.world.tabletop import Tabletop

_POINT = np.zeros((1, 2))


def tilt_of(pose: Pose) -> float:
    """The angle between an object's own z axis and the vertical, radians."""
    x, y, _, _ = pose[1]
    return math.acos(min(1.0, max(-1.0, 1 - 2 * (x * x + y * y))))


class SceneView:
    """What the oracle looks at when it plans one action.

    Args:
        table: as it stands.
        stated: every goal of the episode, met or not, with its words.
        open_goals: those that are not met yet.

    Attributes:
        arm: the robot.
        bounds: (3, 2) lowest and highest x, y, z of the workspace, metres.
        places: where every object stood when the scene had settled, by id.
        ties: what keeps objects together.
        prisms: of every object's colliders.
    """

    def __init__(self, table: Tabletop, stated: Sequence[tuple[Goal, str]], open_goals: Sequence[Goal]) -> None:
        self._table, self.physics = table, table.physics
        self.arm, self.bounds, self.places, self.ties = table.arm, table.bounds, table.places, table.ties
        self.stated_goals, self.open_goals = stated, open_goals
        self._items = {item.id: item for item in table.objects}
        self._models = {number: table.shapes(number) for number in self._items}
        self.prisms: list[Prism] = table.outlines()
        self._supposed: dict[int, Prism] = {}

    def supposing(self, poses: Mapping[int, Pose]) -> "SceneView":
        """The same scene with some objects elsewhere: what a plan would bring about."""
        other = copy.copy(self)
        other._items = self._items | {
            number: self._items[number].model_copy(update={"pose": pose}) for number, pose in poses.items()
        }
        other._supposed = self._supposed | {
            number: footprint(self._models[number], pose, number) for number, pose in poses.items()
        }
        moved = [prism for number, pose in poses.items() for prism in prisms(self._models[number], pose, number)]
        other.prisms = [*self.others(*poses), *moved]
        return other

    @property
    def ids(self) -> tuple[int, ...]:
        """Every object."""
        return tuple(self._items)

    def name(self, number: int) -> str:
        """The asset name of an object."""
        return self._items[number].asset

    def pose(self, number: int) -> Pose:
        """Where it is."""
        return self._items[number].pose

    def yaw(self, number: int) -> float:
        """How it is turned about the vertical, radians."""
        return transforms.yaw_of(self.pose(number)[1])

    def tilt(self, number: int) -> float:
        """The angle between its own z axis and the vertical, radians."""
        return tilt_of(self.pose(number))

    def tilt_at_start(self, number: int) -> float:
        """That angle when the scene had settled, before anything acted."""
        start = self.places.get(number)
        return 0.0 if start is None else tilt_of(start)

    def model(self, number: int) -> ObjectModel:
        """What it is made of."""
        return self._models[number]

    def volume(self, number: int) -> Volume:
        """Its collision volume."""
        return self._table.volume(number)

    def is_free(self, number: int) -> bool:
        """Whether it can be moved."""
        return self._table.is_free(number)

    def hollow(self, number: int) -> bool:
        """Whether things can be put into it."""
        return self._table.library.asset(self.name(number)).hollow

    def outline(self, number: int) -> Prism:
        """One prism around the whole object."""
        return self._supposed[number] if number in self._supposed else self._table.outline(number)

    def parts(self, number: int) -> list[Prism]:
        """The prisms of one object's colliders."""
        return [prism for prism in self.prisms if prism.owner == number]

    def extent(self, number: int) -> tuple[float, float]:
        """Horizontal extents along its own axes as it stands, metres."""
        outline = self.outline(number).outline @ turn(self.yaw(number))
        size = outline.max(axis=0) - outline.min(axis=0)
        return (float(size[0]), float(size[1]))

    def others(self, *numbers: int) -> list[Prism]:
        """The prisms of every object but these."""
        return [prism for prism in self.prisms if prism.owner not in numbers]

    def over(self, number: int, point: Vec3) -> bool:
        """Whether a point lies above an object's outline, seen from above."""
        offset = np.array([[point[0], point[1]]])
        return bool(inside_margin(_POINT, self.outline(number).outline, offset)[0] >= 0)
