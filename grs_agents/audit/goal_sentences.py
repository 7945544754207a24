"""Goals and episode of a task instance in sentences, measured by trusted code, for the judge of the task's words.

A target in numbers becomes the object that lies there. Relations follow from geometry alone: containment, support,
places of other objects at the start, and distances moved.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import LONGEST_NAME, InstanceObject, TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.wording.noun_phrases import join_with_and
from grs_agents.sim.wording.table_state import RESTING, SEEN, TURNED, TableState, name_color, name_object
from grs_agents.sim.world.footprints import Prism
from grs_agents.sim.world.spec import load_object_model

Json = dict[str, Any]
_SAME_PLACE: Final = 0.02
"""Horizontal distance (m) within which two centres are at the same place."""


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


_PASSING: Final = " (not at the end: a later goal takes them on)"


def describe_task_in_words(
    instance: TaskInstance, rollout: Rollout, library: Library, scene: SceneDescription | None = None
) -> TaskInWords:
    """Describe an instance and the trusted oracle's episode; ``scene`` provides the photo's descriptions of objects."""
    table = _Table(TableState(instance, library, rollout.initial, rollout.final), rollout, scene)
    passing = {number for number, goal in enumerate(rollout.episode.goals, 1) if goal.met and goal.shortfalls}
    goals = [
        f"{number}. {words}{_PASSING * (number in passing)}"
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


def name_instance_objects(instance: TaskInstance, library: Library, scene: SceneDescription | None) -> TaskInstance:
    """Set the everyday name of each object, of a proxy as the photo shows it, and mark what the photo lacks."""
    objects: list[InstanceObject] = []
    for item in instance.objects:
        seen = find_matching_photo_object(item, scene)
        words = (seen.category, seen.color) if seen is not None and item.asset.startswith("proxy/") else ()
        name = name_object(item, library, *words)[:LONGEST_NAME] if item.asset in library else ""
        added = scene is not None and seen is None
        objects.append(item.model_copy(update={"name": name, "added": added}))
    return instance.model_copy(update={"objects": tuple(objects)})


def find_matching_photo_object(item: InstanceObject, scene: SceneDescription | None) -> SceneObject | None:
    """The nearest object of the photo with the same asset."""
    seen = (
        [thing for thing in scene.objects if thing.asset == item.asset] if scene is not None and not item.fill else []
    )
    return min(seen, key=lambda thing: math.dist(thing.position, item.pose[0]), default=None)


@dataclass(frozen=True)
class _Table:
    """Objects on the table at the start and at the end of an episode."""

    state: TableState
    rollout: Rollout
    scene: SceneDescription | None

    @property
    def instance(self) -> TaskInstance:
        """The task instance."""
        return self.state.instance

    @cached_property
    def names(self) -> dict[int, str]:
        """Everyday name and number of each object by id, e.g. ``the tomato sauce can #4`` or ``the red block #5``."""
        return {number: f"the {name} #{number}" for number, name in self.state.names.items()}

    def _find_category_color_and_description(self, item: InstanceObject) -> tuple[str, str, str]:
        """Category, colour and description of an object, from the photo if it is in it, else from the library."""
        asset, seen = self.state.library.asset(item.asset), find_matching_photo_object(item, self.scene)
        color = name_color(item) or (seen.color if seen else asset.color)
        if seen is None or item.asset.startswith("proxy/"):
            return (seen.category if seen else asset.category), color, seen.description if seen else asset.description
        return seen.category, color, f"{seen.description}; {asset.description}"

    def describe_objects_as_rows(self) -> Iterator[Json]:
        """A row for each object."""
        for item in self.instance.objects:
            category, color, description = self._find_category_color_and_description(item)
            row: Json = {"id": item.id, "called": self.names[item.id][4:].rpartition(" #")[0]}
            row |= {"category": category, "color": color, "label": self.state.library.asset(item.asset).kind}
            if self.scene is not None and find_matching_photo_object(item, self.scene) is None:
                row["added"] = True
            if item.role == "bystander":
                row["bystander"] = True
            elif not self.state.library.asset(item.asset).template:
                row["description"] = description
            if item.category == "fixed" or item.id in self.state.marks:
                row["fixed"] = True
            if item.id in self.state.hollow:
                row["hollow"] = True
            if (asked := self._find_asked_places(item.id)) is not None:
                row["goal"], row["asked"] = asked
            row["size"] = _round_to_millimetres(load_object_model(item, self.state.library).size)
            if item.id in self.state.end:
                begin, end = self.rollout.initial[item.id], self.rollout.final[item.id]
                row["start"] = _round_to_millimetres(begin[0])
                if stood := self._list_support_phrases(item.id, self.state.start):
                    row["stood"] = stood
                moved, turned = math.dist(begin[0], end[0]), self.state.turn(item.id)
                if moved > SEEN or turned > TURNED:
                    row |= {"end": _round_to_millimetres(end[0]), "moved": round(moved, 3)}
                if turned > TURNED:
                    row["turned"] = round(turned)
                back = transforms.invert_pose(((0, 0, 0), begin[1]))[1]
                x, y, _, _ = transforms.multiply_quaternions(end[1], back)
                if (tipped := math.degrees(math.acos(max(-1.0, 1 - 2 * (x * x + y * y))))) > TURNED:
                    row["tipped"] = round(tipped)
                if actions := [index for index, handled in enumerate(self.rollout.handled, 1) if item.id in handled]:
                    row["actions"] = actions
                if ends := self._list_support_phrases(item.id, self.state.end):
                    row["ends"] = ends
            yield row

    def _find_asked_places(self, number: int) -> tuple[int, list[list[str]]] | None:
        """Number of the last goal of an object, and the places that its goals allow, each as relations; None without
        goal. A line or an upright pose leaves the place to other goals."""
        found: tuple[int, list[list[str]]] | None = None
        standing: list[str] = []
        for index, goal in enumerate(self.instance.goals, 1):
            if number not in goal.objects:
                continue
            row, kind = goal.objects.index(number), goal.relation_kind
            if kind == "stacked" and row == 0 and found is not None:
                continue  # the lowest of a stack stays where an earlier goal put it
            if kind == "stacked":
                places = [[f"on #{goal.objects[row - 1]}"] if row else ["stack"]]
            elif kind in ("aligned", "upright"):
                standing.append(kind)
                places = found[1] if found is not None else [list[str]()]
            elif kind is not None:
                how = {"inside": "in", "near": "beside"}.get(kind, "on")
                apart = [f"within {goal.required_distance:.2f}"] if kind == "near" else []
                places = [[f"{how} #{goal.reference_id}", *apart]]
            elif goal.metric == "zone":
                owners = [self.state.find_zone_support(zone, number) for zone in goal.zones]
                places = [[f"{how} #{owner}" for how, owner in found] for found in owners]
            else:
                targets = [goal.targets[target] for target in goal.allowed_target_indices(row)]
                places = [self._list_target_relations(target, number) for target in targets]
            found = index, places
        return found and (found[0], [[*place, *standing] for place in found[1]])

    def _list_target_relations(self, target: Pose, number: int) -> list[str]:
        supports = self.state.find_supports(self.state.prism(number, target), self.state.end)
        places = [f"{how} #{support}" for how, support in supports]
        left = [f"where #{neighbor}" for neighbor in self._find_who_stood_at(target, number)]
        return [*places, *left, f"at {target[0][0]:.2f} {target[0][1]:.2f}"]

    def _find_who_stood_at(self, target: Pose, number: int) -> Iterator[int]:
        for neighbor, pose in self.rollout.initial.items():
            left = neighbor != number and math.dist(pose[0], self.rollout.final[neighbor][0]) > _SAME_PLACE
            if left and math.dist(pose[0][:2], target[0][:2]) < _SAME_PLACE:
                yield neighbor

    def _list_support_phrases(self, number: int, others: Mapping[int, Prism]) -> list[str]:
        return [f"{how} #{support}" for how, support in self.state.find_supports(others[number], others)]

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
            yield f"{join_with_and([self.names[n] for n in goal.objects])} {_conjugate_end(goal.objects)} {words}"
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
                turned = self.state.turn(number)
                if goal.rotations and goal.symmetries[row] > 0 and turned > TURNED:
                    allowed += f", turned by {turned:.0f} degrees"
            places.setdefault(allowed, []).append(number)
        for words, numbers in places.items():
            yield f"{join_with_and([self.names[n] for n in numbers])} {_conjugate_end(numbers)} {words}"

    def _describe_zone(self, zone: Zone, number: int) -> str:
        """Describe a zone by the smallest object that contains it, else by its size and place."""
        if owner := self.state.find_zone_support(zone, number):
            return f"{owner[0][0]} {self.names[owner[0][1]]}"
        x, y, _ = zone.pose[0]
        width, depth = (f"{100 * extent:.0f} cm" for extent in zone.size[:2])
        return f"in an area without a mark, {width} x {depth}, around ({100 * x:.0f} cm, {100 * y:.0f} cm)"

    def _describe_target(self, target: Pose, number: int) -> str:
        """Describe a pose by its support, by the object that stood there, and by its distance from the start."""
        prism = self.state.prism(number, target)
        words = [f"{how} {self.names[neighbor]}" for how, neighbor in self.state.find_supports(prism, self.state.end)]
        if not words:
            moved = math.dist(self.rollout.initial[number][0], target[0])
            where = "on the bare table" if abs(prism.low) < 2 * RESTING else f"{100 * prism.low:.0f} cm above the table"
            words.append(f"{where}, {100 * moved:.0f} cm from its own start")
        words += [
            f"where {self.names[neighbor]} stands at the start" for neighbor in self._find_who_stood_at(target, number)
        ]
        x, y, _ = target[0]
        return f"{' and '.join(words)}, at ({100 * x:.0f}, {100 * y:.0f})"


def _conjugate_end(numbers: Sequence[int]) -> str:
    return "ends" if len(numbers) == 1 else "end"


def _round_to_millimetres(values: Vec3) -> list[float]:
    return [round(value, 3) for value in values]
