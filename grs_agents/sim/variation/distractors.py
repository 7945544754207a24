"""Objects of the library that stand about and that no goal speaks of."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.variation.places import outline_of_zone, prisms_of_objects
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from grs_agents.sim.world.footprints import object_prism_at_pose, signed_outline_gaps
from grs_agents.sim.world.spec import load_object_model

_WITHIN: Final = ((0.25, -0.5), (0.8, 0.5))
"""Where they may stand, metres: lowest and highest x, y."""
_GAP: Final = 0.025
_WIDE_GAP: Final = 0.1
"""Free space around them, and around what something is to be brought near to, metres."""
_TALLEST, _WIDEST = 0.2, 0.2
"""Metres: higher things would stand in the way of the waiting arm."""
_TRIES: Final = 60


def add_distractors(
    instance: TaskInstance, count: int, rng: np.random.Generator, library: Library
) -> tuple[InstanceObject, ...]:
    """The objects of an instance and ``count`` bystanders at free places; nothing that its words could mean.

    Raises ``SimulationError`` where there is no room for one more.
    """
    choice = list(_assets_unlike_those_of_task(instance, library))
    if not choice:
        raise SimulationError("the library has no other everyday assets", "leave distractors out")
    taken = list(_outlines_to_keep_clear(instance, library))
    objects = list(instance.objects)
    for _ in range(count):
        number = max([FIRST_BYSTANDER - 1, *(item.id for item in objects)]) + 1
        item, outline = _place_distractor_at_random(number, choice, taken, rng, library)
        objects.append(item)
        taken.append((outline, _GAP))
    return tuple(objects)


def _assets_unlike_those_of_task(instance: TaskInstance, library: Library) -> Iterator[Asset]:
    """Everyday assets that are not like anything of the task: neither its kind, nor its sort in its colour."""
    own = [library.asset(item.asset) for item in instance.objects]
    kinds, looks = {asset.kind for asset in own}, {(asset.category, asset.color) for asset in own}
    for asset in library.everyday_assets():
        small = asset.size[2] <= _TALLEST and max(asset.size[:2]) <= _WIDEST
        if small and not asset.hollow and asset.kind not in kinds and (asset.category, asset.color) not in looks:
            yield asset


def _outlines_to_keep_clear(instance: TaskInstance, library: Library) -> Iterator[tuple[FloatArray, float]]:
    """What distractors keep away from, each with the distance (m): objects, marks, zones and targets."""
    prisms = prisms_of_objects(instance, library)
    near = {goal.reference_id for goal in instance.goals if goal.relation_kind == "near"}
    for number, prism in prisms.items():
        yield prism.outline, _WIDE_GAP if number in near else _GAP
    poses = {item.id: item.pose for item in instance.objects}
    for goal in instance.goals:
        for zone in goal.zones:
            yield outline_of_zone(zone), _GAP
        for row, number in enumerate(goal.objects):
            radius = float(np.linalg.norm(prisms[number].outline - np.array(poses[number][0][:2]), axis=1).max())
            for index in goal.allowed_target_indices(row):
                yield _circle_points(goal.targets[index][0][:2], radius), _GAP


def _circle_points(center: tuple[float, float], radius: float) -> FloatArray:
    angles = np.arange(12) * (math.pi / 6)
    return np.array(center) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _place_distractor_at_random(
    number: int,
    choice: list[Asset],
    taken: list[tuple[FloatArray, float]],
    rng: np.random.Generator,
    library: Library,
) -> tuple[InstanceObject, FloatArray]:
    for _ in range(_TRIES):
        asset = choice[int(rng.integers(len(choice)))]
        x, y = rng.uniform(*_WITHIN)
        turn = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(rng.uniform(-math.pi, math.pi))))
        item = InstanceObject(id=number, asset=asset.name, pose=((float(x), float(y), 0.0), turn), role="bystander")
        prism = object_prism_at_pose(load_object_model(item, library), item.pose)
        free = all(
            len(outline) < 3 or signed_outline_gaps(prism.outline, outline, np.zeros((1, 2)))[0] >= gap
            for outline, gap in taken
        )
        if free:
            return item.model_copy(update={"pose": ((float(x), float(y), -prism.low), turn)}), prism.outline
    raise SimulationError(f"no free place for one more distractor in {_TRIES} draws", "ask for fewer distractors")
