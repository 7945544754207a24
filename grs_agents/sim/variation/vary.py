"""From one task instance to another of the same task: data in, data out, no generated code."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import (
    HEAVIEST,
    LEAST_FRICTION,
    LIGHTEST,
    MOST_FRICTION,
    InstanceObject,
    TaskInstance,
)
from grs_agents.sim.variation.appearance import vary_light, vary_table
from grs_agents.sim.variation.base_scene import BaseScene, measure_base_scene, read_masses_and_frictions
from grs_agents.sim.variation.distractors import add_distractors
from grs_agents.sim.variation.parts import Part
from grs_agents.sim.variation.types import Variation

_DRAWS: Final = 20
"""How many scenes are drawn before an instance is given up."""
_TRIES: Final = 12
"""Poses drawn for a part in each of the rounds; then it stays where it is, for that is free."""
_ROUNDS: Final = 2
_TABLE: Final = ((-0.75, -1.15), (1.55, 1.15))
"""What stands on the table has its middle within these (x, y), metres."""


def vary_instance(
    instance: TaskInstance, variation: Variation, rng: np.random.Generator, library: Library
) -> TaskInstance:
    """The same task in another scene.

    Every part of the scene (see ``parts``) is moved by up to ``jitter`` along x and y and turned by up to ``yaw``
    about the vertical, uniformly among the poses where it overlaps nothing, nothing comes onto a mark or a zone or off
    it, targets stay free and what the arm reached it reaches still; where it finds none, the part stays. Then masses,
    friction, light, table top and bystanders are drawn.

    Raises:
        SimulationError: the base cannot be set up, no draw gives a scene that stays as it is put and in which nothing
            is met yet, or there is no room for so many distractors.
    """
    varied = _vary_poses(instance, variation, rng, library) if variation.jitter or variation.yaw else instance
    if variation.mass or variation.friction:
        varied = _copy_with_objects(varied, _vary_masses(varied, measure_base_scene(instance, library), variation, rng))
    if variation.light:
        varied = varied.model_copy(update={"light": vary_light(varied.light, rng)})
    if variation.texture:
        varied = varied.model_copy(update={"table": vary_table(varied, rng)})
    if variation.distractors:
        varied = _copy_with_objects(varied, add_distractors(varied, variation.distractors, rng, library))
    return TaskInstance.model_validate(dict(varied))


def _copy_with_objects(instance: TaskInstance, objects: Sequence[InstanceObject]) -> TaskInstance:
    return instance.model_copy(update={"objects": tuple(objects)})


def _vary_masses(
    instance: TaskInstance, base: BaseScene, variation: Variation, rng: np.random.Generator
) -> list[InstanceObject]:
    """The objects, those that can move with a mass and a friction of their own."""
    known, objects = read_masses_and_frictions(base), list[InstanceObject]()
    for item in instance.objects:
        if item.id not in known:
            objects.append(item)
            continue
        mass, friction = known[item.id]
        heavier, rougher = 1 + rng.uniform(-1, 1, 2) * (variation.mass, variation.friction)
        objects.append(
            item.model_copy(
                update={
                    "mass": float(np.clip(mass * heavier, LIGHTEST, HEAVIEST)),
                    "friction": float(np.clip(friction * rougher, LEAST_FRICTION, MOST_FRICTION)),
                }
            )
        )
    return objects


def _vary_poses(
    instance: TaskInstance, variation: Variation, rng: np.random.Generator, library: Library
) -> TaskInstance:
    base, trouble = measure_base_scene(instance, library), ""
    for _ in range(_DRAWS):
        drawn = _draw_poses(base, variation, rng)
        trouble = base.explain_bad_start(drawn)
        if not trouble:
            return drawn
    raise SimulationError(
        f"none of {_DRAWS} variations of seed {instance.seed} can be begun: {trouble}", "vary the poses less"
    )


def _draw_poses(base: BaseScene, variation: Variation, rng: np.random.Generator) -> TaskInstance:
    """One draw: part after part, in random order, each among the others as they stand by then."""
    objects, goals = base.instance.objects, base.instance.goals
    waiting = list(base.parts)
    for _ in range(_ROUNDS):
        staying: list[Part] = []
        for rank in rng.permutation(len(waiting)):
            part = waiting[int(rank)]
            for _ in range(_TRIES):
                move = _PlanarPartMove.draw_random(part, variation, rng)
                tried, wanted = move.moved_objects(objects), move.moved_goals(goals)
                if _is_on_table(part, tried) and _is_moved_part_valid(base, part, tried, wanted):
                    objects, goals = tried, wanted
                    break
            else:
                staying.append(part)
        waiting = staying
    return base.instance.model_copy(update={"objects": objects, "goals": goals})


def _is_on_table(part: Part, objects: Sequence[InstanceObject]) -> bool:
    low, high = _TABLE
    places = [item.pose[0][:2] for item in objects if item.id in part.objects]
    return bool((np.array(places) > low).all() and (np.array(places) < high).all())


def _is_moved_part_valid(base: BaseScene, part: Part, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> bool:
    """Whether a part stands well where it was moved to; the cheapest question first."""
    return (
        base.keeps_lift_height(part, objects, goals)
        and base.keeps_support_relations(part, objects, goals)
        and base.keeps_clear_of_others(part, objects, goals)
    )


class _PlanarPartMove:
    """A turn of a part about its pivot, then a shift along the table."""

    def __init__(self, part: Part, shift: tuple[float, float], turn: float) -> None:
        self.part, self._shift = part, shift
        self._turn = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, turn))

    @classmethod
    def draw_random(cls, part: Part, variation: Variation, rng: np.random.Generator) -> "_PlanarPartMove":
        """A random one."""
        x, y, turn = rng.uniform(-1, 1, 3).tolist()
        shift = (variation.jitter * x, variation.jitter * y)
        return cls(part, shift, variation.yaw * turn if part.turns else 0.0)

    def moved_pose(self, pose: Pose) -> Pose:
        """Where something of the part comes to be."""
        (x, y, z), rotation = pose
        px, py = self.part.pivot
        dx, dy, _ = transforms.quaternion_to_matrix(self._turn) @ (x - px, y - py, 0.0)
        place = (px + float(dx) + self._shift[0], py + float(dy) + self._shift[1], z)
        return place, transforms.multiply_quaternions(self._turn, rotation)

    def moved_objects(self, objects: Sequence[InstanceObject]) -> tuple[InstanceObject, ...]:
        """All objects, those of the part moved."""
        own = self.part.objects
        return tuple(
            item.model_copy(update={"pose": self.moved_pose(item.pose)}) if item.id in own else item for item in objects
        )

    def moved_goals(self, goals: Sequence[Goal]) -> tuple[Goal, ...]:
        """All goals, their targets and zones moved that belong to the part."""
        return tuple(self._move_goal(number, goal) for number, goal in enumerate(goals))

    def _move_goal(self, number: int, goal: Goal) -> Goal:
        places = {*self.part.targets, *self.part.zones}
        if not any(place[0] == number for place in places):
            return goal
        targets = tuple(
            self.moved_pose(target) if (number, index) in self.part.targets else target
            for index, target in enumerate(goal.targets)
        )
        zones = tuple(
            Zone(pose=self.moved_pose(zone.pose), size=zone.size) if (number, index) in self.part.zones else zone
            for index, zone in enumerate(goal.zones)
        )
        return goal.model_copy(update={"targets": targets, "zones": zones})
