"""Variation of task instances: the same task in another scene, data in, data out, without generated code."""

import colorsys
import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.instance.task_instance import (
    HEAVIEST,
    LEAST_FRICTION,
    LIGHTEST,
    MOST_FRICTION,
    InstanceLight,
    InstanceObject,
    InstanceTable,
    TaskInstance,
)
from grs_agents.sim.variation.base_scene import BaseScene, measure_base_scene, read_masses_and_frictions
from grs_agents.sim.variation.rigid_groups import RigidGroup, prisms_of_objects
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.wording.sentence import describe_task
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from grs_agents.sim.world.footprints import object_prism_at_pose, outline_of_zone, signed_outline_gaps
from grs_agents.sim.world.spec import load_object_model

_ASIDE: Final = 0.6
"""Largest shift of the lamp along x and y, metres; half of it along z."""
_LOWEST: Final = 1.0
_DIM, _BRIGHT = 0.6, 1.3
_APART: Final = 0.25
"""Least distance of the table's colours from those of marks on it, in red, green and blue of 0..1."""
_COLOR_TRIES: Final = 50
_PATTERNS: Final = ("plain", "checker", "speckled")


def vary_light(light: InstanceLight, rng: np.random.Generator) -> InstanceLight:
    """The light moved by up to 60 cm, and between 0.6 and 1.3 times as bright."""
    x, y, z = light.position
    aside = rng.uniform(-_ASIDE, _ASIDE, 3) * (1.0, 1.0, 0.5)
    direct, everywhere = rng.uniform(_DIM, _BRIGHT, 2)

    def scale(color: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
        red, green, blue = (min(1.0, channel * factor) for channel in color)
        return (red, green, blue)

    return InstanceLight(
        position=(float(x + aside[0]), float(y + aside[1]), max(_LOWEST, float(z + aside[2]))),
        target=light.target,
        diffuse=scale(light.diffuse, float(direct)),
        ambient=scale(light.ambient, float(everywhere)),
    )


def vary_table(instance: TaskInstance, rng: np.random.Generator) -> InstanceTable:
    """Another table top: a pattern and two colours, both distinct from those of the marks on it."""
    marks = [item.fill["COLOR"] for item in instance.objects if item.category == "fixed" and "COLOR" in item.fill]
    first = _table_color(rng, marks)
    return InstanceTable(
        color=first,
        pattern=_PATTERNS[int(rng.integers(len(_PATTERNS)))],
        second_color=_table_color(rng, marks),
    )


def _table_color(rng: np.random.Generator, marks: Sequence[Sequence[float | str]]) -> tuple[float, float, float, float]:
    """A colour of common table materials: little saturated, neither black nor glaring."""
    red, green, blue = 0.8, 0.72, 0.6
    for _ in range(_COLOR_TRIES):
        hue, saturation, value = rng.uniform((0.0, 0.0, 0.3), (1.0, 0.45, 0.95))
        red, green, blue = colorsys.hsv_to_rgb(float(hue), float(saturation), float(value))
        away = [np.linalg.norm(np.subtract((red, green, blue), [float(part) for part in mark[:3]])) for mark in marks]
        if min(away, default=1.0) >= _APART:
            break
    return (red, green, blue, 1.0)


_WITHIN: Final = ((0.25, -0.5), (0.8, 0.5))
"""Area of the distractors, metres: lowest and highest x, y."""
_GAP: Final = 0.025
_WIDE_GAP: Final = 0.1
"""Clearance around distractors, and around references of ``near`` goals, metres."""
_TALLEST, _WIDEST = 0.2, 0.2
"""Largest distractors, metres: higher objects would stand in the way of the waiting arm."""
_DISTRACTOR_TRIES: Final = 60


def add_distractors(
    instance: TaskInstance, count: int, rng: np.random.Generator, library: Library
) -> tuple[InstanceObject, ...]:
    """The objects of an instance and ``count`` bystanders at free places, none of which its words could mean.

    Raises ``SimulationError`` if there is no room for all of them.
    """
    present = [library.asset(item.asset) for item in instance.objects]
    kinds, looks = {asset.kind for asset in present}, {(asset.category, asset.color) for asset in present}
    choice = [
        asset
        for asset in library.everyday_assets()
        if asset.size[2] <= _TALLEST
        and max(asset.size[:2]) <= _WIDEST
        and not asset.hollow
        and asset.kind not in kinds
        and (asset.category, asset.color) not in looks
    ]
    if not choice:
        raise SimulationError("the library has no other everyday assets", "leave distractors out")
    taken = list(_outlines_to_keep_clear(instance, library))
    objects = list(instance.objects)
    for _ in range(count):
        number = max([FIRST_BYSTANDER - 1, *(item.id for item in objects)]) + 1
        for _ in range(_DISTRACTOR_TRIES):
            asset = choice[int(rng.integers(len(choice)))]
            x, y = rng.uniform(*_WITHIN).tolist()
            turn = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(rng.uniform(-math.pi, math.pi))))
            item = InstanceObject(id=number, asset=asset.name, pose=((x, y, 0.0), turn), role="bystander")
            prism = object_prism_at_pose(load_object_model(item, library), item.pose)
            if all(
                len(outline) < 3 or signed_outline_gaps(prism.outline, outline, np.zeros((1, 2)))[0] >= gap
                for outline, gap in taken
            ):
                objects.append(item.model_copy(update={"pose": ((x, y, -prism.low), turn)}))
                taken.append((prism.outline, _GAP))
                break
        else:
            tried = f"no free place for one more distractor in {_DISTRACTOR_TRIES} draws"
            raise SimulationError(tried, "ask for fewer distractors")
    return tuple(objects)


def _outlines_to_keep_clear(instance: TaskInstance, library: Library) -> Iterator[tuple[FloatArray, float]]:
    """Outlines of objects, marks, zones and targets, each with the clearance (m) that distractors keep."""
    prisms = prisms_of_objects(instance, library)
    near = {goal.reference_id for goal in instance.goals if goal.relation_kind == "near"}
    for number, prism in prisms.items():
        yield prism.outline, _WIDE_GAP if number in near else _GAP
    poses = {item.id: item.pose for item in instance.objects}
    angles = np.arange(12) * (math.pi / 6)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    for goal in instance.goals:
        for zone in goal.zones:
            yield outline_of_zone(zone), _GAP
        for row, number in enumerate(goal.objects):
            radius = float(np.linalg.norm(prisms[number].outline - np.array(poses[number][0][:2]), axis=1).max())
            for index in goal.allowed_target_indices(row):
                yield np.array(goal.targets[index][0][:2]) + radius * circle, _GAP


_DRAWS: Final = 20
"""Scenes drawn before an instance is given up."""
_POSE_TRIES: Final = 12
"""Poses drawn for a group in a round; without a valid draw it stays, since its place is free."""
_ROUNDS: Final = 2
_TABLE: Final = ((-0.75, -1.15), (1.55, 1.15))
"""Bounds (x, y) of the origins of objects on the table, metres."""


def vary_instance(
    instance: TaskInstance, variation: Variation, rng: np.random.Generator, library: Library
) -> TaskInstance:
    """The same task in another scene.

    Every rigid group of the scene is moved by up to ``jitter`` along x and y and turned by up to ``yaw`` about the
    vertical, uniformly among the poses without overlaps, with unchanged relations to marks and zones, free targets and
    no loss of reach; without any, the group stays. Then masses, friction, light, table top and bystanders are drawn.

    Raises:
        SimulationError: the base cannot be set up, no draw gives a scene that stays in place and in which no goal is
            met yet, or there is no room for all distractors.
    """
    varied = instance
    if variation.jitter or variation.yaw:
        base, trouble = measure_base_scene(instance, library), ""
        for _ in range(_DRAWS):
            varied = _draw_poses(base, variation, rng)
            trouble = base.explain_bad_start(varied)
            if not trouble:
                break
        if trouble:
            raise SimulationError(
                f"none of {_DRAWS} variations of seed {instance.seed} can be begun: {trouble}", "vary the poses less"
            )
    if variation.mass or variation.friction:
        known, objects = read_masses_and_frictions(measure_base_scene(instance, library)), list[InstanceObject]()
        for item in varied.objects:
            if item.id in known:
                mass, friction = known[item.id]
                heavier, rougher = 1 + rng.uniform(-1, 1, 2) * (variation.mass, variation.friction)
                drawn = {
                    "mass": float(np.clip(mass * heavier, LIGHTEST, HEAVIEST)),
                    "friction": float(np.clip(friction * rougher, LEAST_FRICTION, MOST_FRICTION)),
                }
                objects.append(item.model_copy(update=drawn))
            else:
                objects.append(item)
        varied = varied.model_copy(update={"objects": tuple(objects)})
    if variation.light:
        varied = varied.model_copy(update={"light": vary_light(varied.light, rng)})
    if variation.texture:
        varied = varied.model_copy(update={"table": vary_table(varied, rng)})
    if variation.distractors:
        varied = varied.model_copy(update={"objects": add_distractors(varied, variation.distractors, rng, library)})
    if instance.instruction:
        varied = varied.model_copy(update={"instruction": describe_task(varied, library).specific})
    return TaskInstance.model_validate(dict(varied))


def _draw_poses(base: BaseScene, variation: Variation, rng: np.random.Generator) -> TaskInstance:
    """A draw of all groups, in random order, each among the others at their present poses."""
    objects, goals = base.instance.objects, base.instance.goals
    waiting = list(base.groups)
    for _ in range(_ROUNDS):
        staying: list[RigidGroup] = []
        for rank in rng.permutation(len(waiting)):
            group = waiting[int(rank)]
            for _ in range(_POSE_TRIES):
                x, y, turn = rng.uniform(-1, 1, 3).tolist()
                shift = (variation.jitter * x, variation.jitter * y)
                move = _PlanarMove(group, shift, variation.yaw * turn if group.turns else 0.0)
                tried, wanted = move.moved_objects(objects), move.moved_goals(goals)
                origins = np.array([item.pose[0][:2] for item in tried if item.id in group.objects])
                if (
                    (origins > _TABLE[0]).all()
                    and (origins < _TABLE[1]).all()
                    and base.keeps_lift_height(group, tried, wanted)  # the cheapest check first
                    and base.keeps_support_relations(group, tried, wanted)
                    and base.keeps_clear_of_others(group, tried, wanted)
                ):
                    objects, goals = tried, wanted
                    break
            else:
                staying.append(group)
        waiting = staying
    return base.instance.model_copy(update={"objects": objects, "goals": goals})


class _PlanarMove:
    """A turn of a group about its pivot, then a shift along the table."""

    def __init__(self, group: RigidGroup, shift: tuple[float, float], turn: float) -> None:
        self._group, self._shift = group, shift
        self._turn = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, turn))

    def moved_pose(self, pose: Pose) -> Pose:
        """The pose, fixed to the group, after the move."""
        (x, y, z), rotation = pose
        px, py = self._group.pivot
        dx, dy, _ = transforms.quaternion_to_matrix(self._turn) @ (x - px, y - py, 0.0)
        place = (px + float(dx) + self._shift[0], py + float(dy) + self._shift[1], z)
        return place, transforms.multiply_quaternions(self._turn, rotation)

    def moved_objects(self, objects: Sequence[InstanceObject]) -> tuple[InstanceObject, ...]:
        """All objects, those of the group moved."""
        members = self._group.objects
        return tuple(
            item.model_copy(update={"pose": self.moved_pose(item.pose)}) if item.id in members else item
            for item in objects
        )

    def moved_goals(self, goals: Sequence[Goal]) -> tuple[Goal, ...]:
        """All goals, the targets and zones of the group moved."""
        places = {*self._group.targets, *self._group.zones}
        touched = {number for number, _ in places}
        moved: list[Goal] = []
        for number, goal in enumerate(goals):
            if number in touched:
                targets = tuple(
                    self.moved_pose(target) if (number, index) in self._group.targets else target
                    for index, target in enumerate(goal.targets)
                )
                zones = tuple(
                    Zone(pose=self.moved_pose(zone.pose), size=zone.size)
                    if (number, index) in self._group.zones
                    else zone
                    for index, zone in enumerate(goal.zones)
                )
                moved.append(goal.model_copy(update={"targets": targets, "zones": zones}))
            else:
                moved.append(goal)
        return tuple(moved)
