"""Goals and episode of a task instance in sentences, measured by trusted code, for the judge of the task's words.

A target in numbers becomes the object that lies there. Relations follow from geometry alone: containment, support,
places of other objects at the start, and distances moved.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from grs_agents.audit.goal_checks import zone_outline
from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim import utils
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import (
    Prism,
    distance_between_outlines,
    margins_inside_outline,
    object_prism_at_pose,
)
from grs_agents.sim.world.spec import load_object_model

Json = dict[str, Any]
_RESTING: Final = 0.015
"""An underside within this height (m) of a top lies on it: targets are often a little too high."""
_SAME_PLACE: Final = 0.02
"""Horizontal distance (m) within which two centres are at the same place."""
_SEEN: Final = 0.01
"""Least displacement (m) that people see."""
_TURNED: Final = 10
"""Least turn (degrees) that people see."""
_DEEP: Final = 0.02
"""Height of walls (m) from which objects lie in a container rather than on it, as on a plate."""
_POINT: Final = np.zeros((1, 2))


@dataclass(frozen=True)
class TaskInWords:
    """A task instance in words."""

    objects: tuple[Json, ...]  # a row for each object on the table; lengths in metres, robot frame
    goals: tuple[str, ...]  # a sentence for each goal, in order
    other_texts: tuple[str, ...] = ()  # the program's sentences for its goals, e.g. `goals 1 and 2: put it there`

    @property
    def kind(self) -> tuple[object, ...]:
        """Key of the kind of scene: everything but lengths and turns. Places on the table count, since words may name
        an order."""
        words = [re.sub(r"-?\d+ (cm|degrees)", "", sentence) for sentence in self.goals]
        return (
            *self.other_texts,
            *words,
            *((row["called"], *row.get("stood", ()), "->", *row.get("ends", ())) for row in self.objects),
        )


def describe_task_in_words(
    instance: TaskInstance, rollout: Rollout, library: Library, scene: SceneDescription | None = None
) -> TaskInWords:
    """Describe an instance and the trusted oracle's episode; ``scene`` provides the photo's descriptions of objects."""
    table = _Table(instance, rollout, library, scene)
    goals = [
        f"{number}. {words}"
        for number, goal in enumerate(instance.goals, 1)
        for words in table.list_goal_sentences(goal)
    ]
    if instance.primitive == "push":
        goals.append("The robot pushes things with a spatula and picks nothing up.")
    numbers: dict[str, list[str]] = {}  # of the goals by the sentence that the program gives them
    for number, goal in enumerate(instance.goals, 1):
        numbers.setdefault(" ".join(goal.language.split()), []).append(str(number))
    texts = [
        f"{'goals' if len(listed) > 1 else 'goal'} {' and '.join(listed)}: {sentence}"
        for sentence, listed in numbers.items()
        if sentence
    ]
    return TaskInWords(tuple(table.describe_objects_as_rows()), tuple(goals), tuple(texts))


@dataclass(frozen=True)
class _Table:
    """Objects on the table at the start and at the end of an episode."""

    instance: TaskInstance
    rollout: Rollout
    library: Library
    scene: SceneDescription | None

    @cached_property
    def names(self) -> dict[int, str]:
        """Everyday name and number of each object by id, e.g. ``the tomato sauce can #4`` or ``the red block #5``."""
        names: dict[int, str] = {}
        for item in self.instance.objects:
            category, color, _ = self._find_category_color_and_description(item)
            asset, (folder, _, file) = self.library.asset(item.asset), item.asset.rpartition("/")
            if folder in ("block", "proxy", "zone") or asset.template or not asset.everyday:
                name = f"{color} {'block' if folder == 'block' else category}"
            else:
                name = re.sub(r"(?<=[a-z])(?=[A-Z])|[_-]", " ", file.removesuffix(".urdf")).lower()
                if category not in name.split():
                    name = f"{name} {category}"
            names[item.id] = f"the {name} #{item.id}"
        return names

    @cached_property
    def start(self) -> dict[int, Prism]:
        """The prism around each object at the start."""
        return self._compute_prism_per_object(self.rollout.initial)

    @cached_property
    def end(self) -> dict[int, Prism]:
        """The prism around each object at the end."""
        return self._compute_prism_per_object(self.rollout.final)

    @cached_property
    def hollow(self) -> set[int]:
        """Ids of the objects in or on which others can be put."""
        return {item.id for item in self.instance.objects if self.library.asset(item.asset).hollow}

    @cached_property
    def walled(self) -> set[int]:
        """Ids of the hollow objects with walls at least ``_DEEP`` high."""
        return {
            item.id
            for item in self.instance.objects
            if item.id in self.hollow
            and (inner := measure_inner_size(load_object_model(item, self.library), self.library)) is not None
            and inner[2] >= _DEEP
        }

    @cached_property
    def marks(self) -> set[int]:
        """Ids of the marks: objects without colliders."""
        return {item.id for item in self.instance.objects if not load_object_model(item, self.library).colliders}

    def _compute_prism_per_object(self, poses: Mapping[int, Pose]) -> dict[int, Prism]:
        return {
            item.id: object_prism_at_pose(load_object_model(item, self.library), poses[item.id], item.id)
            for item in self.instance.objects
            if item.id in poses
        }

    def _find_category_color_and_description(self, item: InstanceObject) -> tuple[str, str, str]:
        """Category, colour and description of an object, from the photo if it is in it, else from the library."""
        asset, seen = self.library.asset(item.asset), self._find_matching_photo_object(item)
        color = seen.color if seen else asset.color
        rgb = item.color or tuple(float(value) for value in item.fill.get("COLOR", ()) if not isinstance(value, str))
        if len(rgb) >= 3:  # the program set it
            named = min(utils.COLORS, key=lambda name: math.dist(utils.COLORS[name], rgb[:3]))
            exact = math.dist(utils.COLORS[named], rgb[:3]) < 0.02
            color = named if exact else color_name_from_rgb((rgb[0], rgb[1], rgb[2]))
        if seen is None or item.asset.startswith("proxy/"):
            return (seen.category if seen else asset.category), color, seen.description if seen else asset.description
        return seen.category, color, f"{seen.description}; {asset.description}"

    def _find_matching_photo_object(self, item: InstanceObject) -> SceneObject | None:
        """The nearest object of the photo with the same asset."""
        seen = [thing for thing in self.scene.objects if thing.asset == item.asset] if self.scene else []
        return min(seen, key=lambda thing: math.dist(thing.position, item.pose[0]), default=None)

    def describe_objects_as_rows(self) -> Iterator[Json]:
        """A row for each object."""
        for item in self.instance.objects:
            category, color, description = self._find_category_color_and_description(item)
            row: Json = {"id": item.id, "called": self.names[item.id][4:].rpartition(" #")[0]}
            row |= {"category": category, "color": color}
            if self.scene is not None and self._find_matching_photo_object(item) is None:
                row["added"] = True
            if item.role == "bystander":
                row["bystander"] = True
            elif not self.library.asset(item.asset).template:
                row["description"] = description
            if item.category == "fixed" or item.id in self.marks:
                row["fixed"] = True
            if item.id in self.hollow:
                row["hollow"] = True
            row["size"] = _round_to_millimetres(load_object_model(item, self.library).size)
            if item.id in self.end:
                begin, end = self.rollout.initial[item.id], self.rollout.final[item.id]
                row["start"] = _round_to_millimetres(begin[0])
                if stood := self._list_support_phrases(self.start[item.id], self.start):
                    row["stood"] = stood
                moved, turned = math.dist(begin[0], end[0]), self._turn_angle_degrees(item.id)
                if moved > _SEEN or turned > _TURNED:
                    row |= {"end": _round_to_millimetres(end[0]), "moved": round(moved, 3)}
                if turned > _TURNED:
                    row["turned"] = round(turned)
                back = transforms.invert_pose(((0, 0, 0), begin[1]))[1]
                x, y, _, _ = transforms.multiply_quaternions(end[1], back)
                if (tipped := math.degrees(math.acos(max(-1.0, 1 - 2 * (x * x + y * y))))) > _TURNED:
                    row["tipped"] = round(tipped)
                if actions := [index for index, handled in enumerate(self.rollout.handled, 1) if item.id in handled]:
                    row["actions"] = actions
                if ends := self._list_support_phrases(self.end[item.id], self.end):
                    row["ends"] = ends
            yield row

    def _turn_angle_degrees(self, number: int) -> float:
        """Degrees by which an object turns."""
        return math.degrees(transforms.angle_between(self.rollout.initial[number][1], self.rollout.final[number][1]))

    def _list_support_phrases(self, prism: Prism, others: Mapping[int, Prism]) -> list[str]:
        return [f"{how} #{number}" for how, number in self._find_supports(prism, others)]

    def _find_supports(self, prism: Prism, others: Mapping[int, Prism]) -> list[tuple[str, int]]:
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
            if over and number in self.walled and support.low - _RESTING <= prism.low < support.high - 0.002:
                supports.append(("in", number))
            elif over and number in self.marks | self.hollow:
                if support.low - _RESTING <= prism.low < support.high + _RESTING:
                    supports.append(("on", number))
            elif (
                prism.low > (support.low + support.high) / 2  # grains lie beside each other
                and abs(prism.low - support.high) < _RESTING
                and distance_between_outlines(prism.outline, support.outline) <= 0
            ):
                supports.append(("on", number))
        return supports

    def list_goal_sentences(self, goal: Goal) -> Iterator[str]:
        """A sentence for all objects of a goal that may end at the same places."""
        if goal.relation is not None:
            kind, distance = goal.relation_kind, goal.required_distance
            reference = self.names[goal.reference_id] if goal.relation.reference is not None else ""
            apart = f", {100 * distance:.0f} cm from centre to centre" if distance else ""
            words = {
                "inside": f"in {reference}",
                "on": f"on {reference}",
                "in_zone": f"on {reference}",
                "near": f"beside {reference}, at most {100 * (distance or 0):.0f} cm from it",
                "stacked": "stacked, in this order from the bottom up",
                "aligned": f"on one line{apart}",
            }.get(str(kind), "standing upright")
            yield f"{self._list_names(goal.objects)} {_conjugate_end(goal.objects)} {words}"
            return
        places: dict[str, list[int]] = {}
        for row, number in enumerate(goal.objects):
            if goal.metric == "zone":
                allowed = "; or ".join(dict.fromkeys(self._describe_zone(zone, number) for zone in goal.zones))
            else:
                targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
                described = list(dict.fromkeys(self._describe_target(target, number) for target in targets))
                allowed = "; or ".join(described)
                if len(described) > 1 and not goal.replace:
                    allowed += ", each place for one of them"
                turned = self._turn_angle_degrees(number)
                if goal.rotations and goal.symmetries[row] > 0 and turned > _TURNED:
                    allowed += f", turned by {turned:.0f} degrees"
            places.setdefault(allowed, []).append(number)
        for words, numbers in places.items():
            yield f"{self._list_names(numbers)} {_conjugate_end(numbers)} {words}"

    def _list_names(self, numbers: Iterable[int]) -> str:
        names = [self.names[number] for number in numbers]
        return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

    def _describe_zone(self, zone: Zone, number: int) -> str:
        """Describe a zone by the smallest object that contains it, else by its size and place."""
        corners = zone_outline(zone)
        around = [
            (float(np.ptp(prism.outline, axis=0).prod()), container)
            for container, prism in self.end.items()
            if container != number and margins_inside_outline(corners, prism.outline, _POINT)[0] >= -_SEEN
        ]
        if around:
            container = min(around)[1]
            return f"{'in' if container in self.walled else 'on'} {self.names[container]}"
        x, y, _ = zone.pose[0]
        width, depth = (f"{100 * extent:.0f} cm" for extent in zone.size[:2])
        return f"in an area without a mark, {width} x {depth}, around ({100 * x:.0f} cm, {100 * y:.0f} cm)"

    def _describe_target(self, target: Pose, number: int) -> str:
        """Describe a pose by its support, by the object that stood there, and by its distance from the start."""
        item = next(item for item in self.instance.objects if item.id == number)
        prism = object_prism_at_pose(load_object_model(item, self.library), target, number)
        words = [f"{how} {self.names[neighbor]}" for how, neighbor in self._find_supports(prism, self.end)]
        if not words:
            moved = math.dist(self.rollout.initial[number][0], target[0])
            where = (
                "on the bare table" if abs(prism.low) < 2 * _RESTING else f"{100 * prism.low:.0f} cm above the table"
            )
            words.append(f"{where}, {100 * moved:.0f} cm from its own start")
        for neighbor, pose in self.rollout.initial.items():
            left = neighbor != number and math.dist(pose[0], self.rollout.final[neighbor][0]) > _SAME_PLACE
            if left and math.dist(pose[0][:2], target[0][:2]) < _SAME_PLACE:
                words.append(f"where {self.names[neighbor]} stands at the start")
        x, y, _ = target[0]
        return f"{' and '.join(words)}, at ({100 * x:.0f}, {100 * y:.0f})"


def _conjugate_end(numbers: Sequence[int]) -> str:
    return "ends" if len(numbers) == 1 else "end"


def _round_to_millimetres(values: Vec3) -> list[float]:
    return [round(value, 3) for value in values]
