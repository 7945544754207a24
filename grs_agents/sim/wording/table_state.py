"""Objects of a task instance at the start and at the end of an episode: names, outlines and supports."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.library import Library
from grs_agents.sim import utils
from grs_agents.sim.instance.goal import Zone
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import (
    Prism,
    distance_between_outlines,
    margins_inside_outline,
    object_prism_at_pose,
    outline_of_zone,
)
from grs_agents.sim.world.spec import load_object_model

SEEN: Final = 0.01
"""Least displacement (m) that people see."""
TURNED: Final = 10
"""Least turn (degrees) that people see."""
RESTING: Final = 0.015
"""An underside within this height (m) of a top lies on it: targets are often a little too high."""
_DEEP: Final = 0.02
"""Height of walls (m) from which objects lie in a container rather than on it, as on a plate."""
_POINT: Final = np.zeros((1, 2))


EDITED: Final = "edited_"
"""Beginning of the folders of copies of assets with the mass or friction that a person gave."""


def name_object(item: InstanceObject, library: Library, category: str = "", color: str = "") -> str:
    """Everyday name of an object, e.g. ``tomato sauce can`` or ``red block``, the same for equal objects.

    Args:
        item: the object; a colour that the program set prevails.
        category: as the photo shows it, for a proxy; by default the library's.
        color: likewise.
    """
    asset, (folder, _, file) = library.asset(item.asset), item.asset.rpartition("/")
    category, color = category or asset.category, name_color(item) or color or asset.color
    if folder in ("block", "proxy", "zone") or asset.template or not (asset.everyday or folder.startswith(EDITED)):
        return f"{color} {'block' if folder == 'block' else category}"
    name = re.sub(r"(?<=[a-z])(?=[A-Z])|[_-]", " ", file.removesuffix(".urdf")).lower()
    if category in (folder, *name.split()):
        return name
    return f"{re.sub(r'(?<=[a-z]{3})s$', '', name)} {category}"  # a cookie box


def name_color(item: InstanceObject) -> str:
    """Name of the colour that the program gave an object; empty if it gave none."""
    rgb = item.color or tuple(float(value) for value in item.fill.get("COLOR", ()) if not isinstance(value, str))
    if len(rgb) < 3:
        return ""
    named = min(utils.COLORS, key=lambda name: math.dist(utils.COLORS[name], rgb[:3]))
    exact = math.dist(utils.COLORS[named], rgb[:3]) < 0.02
    return named if exact else color_name_from_rgb((rgb[0], rgb[1], rgb[2]))


@dataclass(frozen=True)
class TableState:
    """A task instance with the poses of its objects at the start and at the end."""

    instance: TaskInstance
    library: Library
    initial: Mapping[int, Pose]
    final: Mapping[int, Pose]

    @cached_property
    def items(self) -> dict[int, InstanceObject]:
        """Each object by id."""
        return {item.id: item for item in self.instance.objects}

    @cached_property
    def names(self) -> dict[int, str]:
        """Everyday name of each object, without article; equal objects share it."""
        return {item.id: item.name or name_object(item, self.library) for item in self.instance.objects}

    @cached_property
    def start(self) -> dict[int, Prism]:
        """The prism around each object at the start."""
        return {number: self.prism(number, pose) for number, pose in self.initial.items() if number in self.items}

    @cached_property
    def end(self) -> dict[int, Prism]:
        """The prism around each object at the end."""
        return {number: self.prism(number, pose) for number, pose in self.final.items() if number in self.items}

    @cached_property
    def hollow(self) -> set[int]:
        """Ids of the objects in or on which others can be put."""
        return {item.id for item in self.instance.objects if self.library.asset(item.asset).hollow}

    @cached_property
    def walled(self) -> set[int]:
        """Ids of the hollow objects with walls at least ``_DEEP`` high."""
        return {
            number
            for number in self.hollow
            if (inner := measure_inner_size(load_object_model(self.items[number], self.library), self.library))
            is not None
            and inner[2] >= _DEEP
        }

    @cached_property
    def marks(self) -> set[int]:
        """Ids of the marks: objects without colliders."""
        return {item.id for item in self.instance.objects if not load_object_model(item, self.library).colliders}

    @cached_property
    def displaced(self) -> set[int]:
        """Ids of the objects that end visibly elsewhere or turned."""
        return {
            number
            for number in self.initial.keys() & self.final.keys()
            if self.displacement(number) > SEEN or self.turn(number) > TURNED
        }

    def prism(self, number: int, pose: Pose) -> Prism:
        """The prism around an object at a pose."""
        return object_prism_at_pose(load_object_model(self.items[number], self.library), pose, number)

    def displacement(self, number: int) -> float:
        """Distance (m) of an object's end from its start."""
        return math.dist(self.initial[number][0], self.final[number][0])

    def turn(self, number: int) -> float:
        """Degrees by which an object turns."""
        return math.degrees(transforms.angle_between(self.initial[number][1], self.final[number][1]))

    def find_supports(self, prism: Prism, others: Mapping[int, Prism]) -> list[tuple[str, int]]:
        """Relation (``in`` or ``on``) and id of each object that contains or supports an object."""
        if prism.owner in self.marks:
            return []
        supports: list[tuple[str, int]] = []
        x0, y0, x1, y1 = prism.bounding_box_xy
        middle = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
        for number, support in others.items():
            if number == prism.owner:
                continue
            over = bool(margins_inside_outline(_POINT, support.outline, middle)[0] >= 0)
            if over and number in self.walled and support.low - RESTING <= prism.low < support.high - 0.002:
                supports.append(("in", number))
            elif over and number in self.marks | self.hollow:
                if support.low - RESTING <= prism.low < support.high + RESTING:
                    supports.append(("on", number))
            elif (
                prism.low > (support.low + support.high) / 2  # grains lie beside each other
                and abs(prism.low - support.high) < RESTING
                and distance_between_outlines(prism.outline, support.outline) <= 0
            ):
                supports.append(("on", number))
        return supports

    def find_zone_support(self, zone: Zone, number: int) -> list[tuple[str, int]]:
        """Relation and id of the smallest other object that contains a zone at the end; empty if there is none."""
        corners = outline_of_zone(zone)
        around = [
            (float(np.ptp(prism.outline, axis=0).prod()), container)
            for container, prism in self.end.items()
            if container != number and margins_inside_outline(corners, prism.outline, _POINT)[0] >= -SEEN
        ]
        return [("in" if min(around)[1] in self.walled else "on", min(around)[1])] if around else []


def predict_final_poses(instance: TaskInstance) -> dict[int, Pose]:
    """Pose of each object once all goals are met, as far as pose goals fix it; elsewhere the pose at the start."""
    poses = {item.id: item.pose for item in instance.objects}
    for goal in instance.goals:
        for row, number in enumerate(goal.objects if goal.metric == "pose" else ()):
            if allowed := goal.allowed_target_indices(row):
                poses[number] = goal.targets[allowed[0]]
    return poses
