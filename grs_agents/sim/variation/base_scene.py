"""What is measured of a base instance once, for all of its variations: contacts, reach, who stands on which mark."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.errors import GrsError
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.goals.scene_view import SceneView
from grs_agents.sim.goals.strict_score import match_rows_to_targets
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance, hash_instance
from grs_agents.sim.rollouts import InstanceTask, score_goals_by_latest_mention
from grs_agents.sim.variation.parts import Part, find_parts
from grs_agents.sim.variation.places import Place, outline_of_zone, prisms_of_objects
from grs_agents.sim.world.compilation import compile_world, reset_world_to_poses
from grs_agents.sim.world.footprints import (
    Prism,
    find_nearby_prisms,
    find_prisms_at_pose,
    margins_inside_outline,
    signed_outline_gaps,
)
from grs_agents.sim.world.spec import instance_to_spec, load_object_model

Pair = tuple[int, int]
"""Ids of two objects, the lower one first; -1 is the arm, or what stands around it."""
TOUCHING: Final = 0.0005
"""Objects that reach less deep (m) into each other are apart: contacts of what stands side by side are no deeper."""
MET: Final = 0.985
"""From this score on a goal counts as met."""
_DEEPER: Final = 0.001
_SHIFT, _SINK, _TILT = 0.02, 0.03, np.deg2rad(15)
"""What settling moves sideways or in height (m), or turns by more than this, was not put where it can stand."""
_APPROACH: Final = 0.04
_CLEAR: Final = 0.04
"""Metres above where something is put down, and above what it is carried over."""
_RISES: Final = np.arange(0.0, 0.62, 0.02)
_POINT: Final = np.zeros((1, 2))
_REMEMBERED: Final = 8
_ENDLESS: Final = 10**12
"""Simulated steps: one environment serves all variations."""


@dataclass(frozen=True)
class RegionRelation:
    """How an object stands to a mark or a zone, seen from above."""

    touches: bool
    centred: bool


@dataclass(frozen=True)
class Region:
    """A mark, or the zone of a goal: what is on it stays on it, what is not comes not."""

    outline: FloatArray
    owner: int  # the mark's id, -1 for a zone that nothing shows


def _sorted_pair(one: int, other: int) -> Pair:
    return (min(one, other), max(one, other))


def _prisms_overlap(one: Prism, other: Prism) -> bool:
    upwards = min(one.high, other.high) - max(one.low, other.low)
    return upwards > TOUCHING and signed_outline_gaps(one.outline, other.outline, _POINT)[0] < -TOUCHING


class BaseScene:
    """A task instance with its compiled world and what holds of it. Raises ``GrsError``: it cannot be set up."""

    def __init__(self, instance: TaskInstance, library: Library) -> None:
        self.instance, self.library = instance, library
        self._env = Environment(library=library, seed=instance.seed, budget=_ENDLESS, robot=instance.robot)
        self._env.timestep = instance.timestep
        task = self._settle_instance(instance)
        ids = {number: own for own, number in task.ids.items()}
        view = SceneView(self._env, task.grs.stated, task.goals)
        self.arm = self._env.arm
        self.parts = find_parts(instance, library, view, ids)
        self.scores = score_goals_by_latest_mention(task)
        self.restless = frozenset(self._find_objects_moved_by_settling(instance, task))
        self.world = compile_world(instance_to_spec(instance, library))
        self.models = {item.id: load_object_model(item, library) for item in instance.objects}
        self.end_depths = self.contact_depths(self.objects_at_goals(instance.objects, instance.goals))
        self._prisms = prisms = prisms_of_objects(instance, library)
        self.ceilings = {part: self._lift_heights_needed(part, instance.objects, instance.goals) for part in self.parts}
        self.standings = {
            (index, number): relation_to_region(
                region, prisms[number], self._object_position_xy(number, instance.objects)
            )
            for index, region in enumerate(self.regions(instance.objects, instance.goals))
            for number in prisms
        }

    def _settle_instance(self, instance: TaskInstance) -> InstanceTask:
        """The instance's scene, at rest, in the environment that is kept for it."""
        task = InstanceTask(instance)
        self._env.set_task(task)
        self._env.reset()
        return task

    def _find_objects_moved_by_settling(self, instance: TaskInstance, task: InstanceTask) -> list[int]:
        """Ids of what settling moves from where the instance puts it."""
        moved: list[int] = []
        for item in instance.objects:
            (x, y, z), turn = self._env.get_object_pose(task.ids[item.id])
            (x0, y0, z0), turn0 = item.pose
            away = np.hypot(x - x0, y - y0) > _SHIFT or abs(z - z0) > _SINK
            if away or transforms.angle_between(turn, turn0) > _TILT:
                moved.append(item.id)
        return moved

    def explain_bad_start(self, instance: TaskInstance) -> str:
        """Why an episode cannot begin in a variation: it cannot be set up, does not stay, or meets a goal by itself."""
        try:
            task = self._settle_instance(instance)
        except GrsError as error:
            return error.message
        if fallen := sorted(set(self._find_objects_moved_by_settling(instance, task)) - self.restless):
            return f"objects {fallen} do not stay where they are put"
        scores = score_goals_by_latest_mention(task)
        met = [index for index, score in enumerate(scores) if score >= MET > self.scores[index]]
        return f"goals {met} are met before anything is done" if met or min(scores, default=0.0) >= MET else ""

    def contact_depths(self, objects: Sequence[InstanceObject]) -> dict[Pair, float]:
        """How deep (m) each pair of things reaches into each other, by exact contacts, of which one at least can move;
        the table top does not count."""
        world, data = self.world, self.world.data
        reset_world_to_poses(world, objects)
        data.qpos[: world.arm.dof] = world.arm.home_joints
        mujoco.mj_kinematics(world.model, data)
        mujoco.mj_comPos(world.model, data)
        mujoco.mj_collision(world.model, data)
        depths: dict[Pair, float] = {}
        for geoms, distance in zip(data.contact.geom.reshape(-1, 2).tolist(), data.contact.dist.tolist(), strict=True):
            if distance < 0 and self._table not in geoms:
                pair = _sorted_pair(world.owners[int(geoms[0])], world.owners[int(geoms[1])])
                if pair[0] != pair[1]:
                    depths[pair] = max(depths.get(pair, 0.0), -distance)
        return depths

    @cached_property
    def _table(self) -> int:
        return int(self.world.model.geom("table").id)

    def _has_new_fixed_overlap(self, part: Part, objects: Sequence[InstanceObject]) -> bool:
        """Whether a fixed thing of a part reaches into another one by upright prisms: these do not collide in MuJoCo.

        Those that overlap in the base already are let be.
        """
        prisms = self._list_fixed_prisms(objects)
        own = [prism for prism in prisms if prism.owner in part.objects]
        others = [prism for prism in prisms if prism.owner not in part.objects]
        pairs = ((prism, other) for prism in own for other in find_nearby_prisms(prism, others, (0.0, 0.0), 0.0))
        return any(
            _sorted_pair(one.owner, other.owner) not in self._base_fixed_overlap_pairs and _prisms_overlap(one, other)
            for one, other in pairs
        )

    @cached_property
    def _base_fixed_overlap_pairs(self) -> frozenset[Pair]:
        return frozenset(
            _sorted_pair(one.owner, other.owner)
            for one, other in combinations(self._list_fixed_prisms(self.instance.objects), 2)
            if one.owner != other.owner and _prisms_overlap(one, other)
        )

    def _list_fixed_prisms(self, objects: Sequence[InstanceObject]) -> list[Prism]:
        fixed = [item for item in objects if item.id not in self.world.addresses]
        prisms = [prism for item in fixed for prism in find_prisms_at_pose(self.models[item.id], item.pose, item.id)[0]]
        return prisms + self._background

    @cached_property
    def _background(self) -> list[Prism]:
        name = self.instance.background
        pose: Pose = ((0.0, 0.0, 0.0), transforms.IDENTITY)
        return [] if name is None else find_prisms_at_pose(self.library.load_object_model(name), pose, -1)[0]

    def objects_at_goals(self, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> tuple[InstanceObject, ...]:
        """The objects with those of pose goals at their targets, as far as these say where that is."""
        items = {item.id: item for item in objects}
        for goal in goals:
            if goal.metric == "pose":
                options = [goal.allowed_target_indices(row) for row in range(len(goal.objects))]
                first = {row: choice[0] for row, choice in enumerate(options) if choice}
                for row, index in (first if goal.replace else match_rows_to_targets(options)).items():
                    item, (place, turn) = items[goal.objects[row]], goal.targets[index]
                    yaw = transforms.yaw_of_quaternion(turn) - transforms.yaw_of_quaternion(item.pose[1])
                    about = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, yaw if goal.rotations else 0.0))
                    pose = (place, transforms.multiply_quaternions(about, item.pose[1]))
                    items[item.id] = item.model_copy(update={"pose": pose})
        return tuple(items.values())

    def regions(self, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> list[Region]:
        """The marks on the table, and the zones of goals that no part moves; always in the same order."""
        marks = [
            Region(find_prisms_at_pose(self.models[item.id], item.pose, item.id)[1].outline, item.id)
            for item in objects
            if not self.models[item.id].colliders
        ]
        owned: set[Place] = {place for part in self.parts for place in part.zones}
        return marks + [
            Region(outline_of_zone(zone), -1)
            for number, goal in enumerate(goals)
            for index, zone in enumerate(goal.zones)
            if (number, index) not in owned
        ]

    def _object_position_xy(self, number: int, objects: Sequence[InstanceObject]) -> tuple[float, float]:
        x, y, _ = next(item.pose[0] for item in objects if item.id == number)
        return (x, y)

    def _lift_heights_needed(self, part: Part, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> FloatArray:
        """How high (N,; m) the arm can lift at each place of a part, 0 where it does not get there, at most as high as
        carrying needs: at what can move and at the middle of targets and zones over all else, at corners just up."""
        size = {item.id: self.models[item.id].size[2] for item in objects}
        over, tips = self._highest_solid_point + _CLEAR, list[tuple[float, float, float, float]]()
        for item in objects:
            if item.id in part.objects and item.id in self.world.addresses:
                x, y, z = item.pose[0]
                tips.append((x, y, max(0.0, z + size[item.id] / 2), size[item.id] + over))
        for number, index in sorted(part.targets):
            (x, y, z), tall = goals[number].targets[index][0], max(size[own] for own in goals[number].objects)
            tips.append((x, y, z + tall / 2, tall + over))
        for number, index in sorted(part.zones):
            zone, tall = goals[number].zones[index], max(size[own] for own in goals[number].objects)
            tips.append((*zone.pose[0][:2], tall, tall + over))
            tips += [(float(x), float(y), tall, tall + _APPROACH) for x, y in outline_of_zone(zone)]
        if not tips:
            return np.zeros(0)
        places = np.array(tips)
        heights = np.minimum(places[:, 2:3] + _RISES, places[:, 3:])
        grid = np.concatenate([np.repeat(places[:, None, :2], len(_RISES), axis=1), heights[:, :, None]], axis=2)
        served = self.arm.reachable_mask(grid.reshape(-1, 3)).reshape(heights.shape)
        return np.where(np.logical_and.accumulate(served, axis=1), heights, 0.0).max(axis=1)

    @cached_property
    def _highest_solid_point(self) -> float:
        """How high anything solid reaches, metres."""
        solid = [prism.high for number, prism in self._prisms.items() if self.models[number].colliders]
        return max(solid, default=0.0)

    def keeps_lift_height(self, part: Part, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> bool:
        """Whether the arm still lifts as high at each place of a part as it did in the base."""
        return bool((self._lift_heights_needed(part, objects, goals) >= self.ceilings[part] - 1e-9).all())

    def keeps_support_relations(self, part: Part, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> bool:
        """Whether nothing of a part has come upon a mark or a zone or off it, nor any other thing on or off its own."""
        prisms = {item.id: find_prisms_at_pose(self.models[item.id], item.pose, item.id)[1] for item in objects}
        centers = {item.id: item.pose[0][:2] for item in objects}
        for index, region in enumerate(self.regions(objects, goals)):
            mine = region.owner in part.objects
            for number in (prisms.keys() - part.objects) if mine else part.objects:
                if number == region.owner:
                    continue
                before, now = self.standings[index, number], relation_to_region(region, prisms[number], centers[number])
                if now.centred != before.centred or (now.touches and not before.touches):
                    return False
        return True

    def keeps_clear_of_others(self, part: Part, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> bool:
        """Whether a part, as it stands now, touches nothing else, and the targets of pose goals are still free."""
        for (one, other), depth in self.contact_depths(objects).items():
            if depth > TOUCHING and (one in part.objects) != (other in part.objects):
                return False
        if self._has_new_fixed_overlap(part, objects):
            return False
        ends = self.contact_depths(self.objects_at_goals(objects, goals))
        return all(depth <= max(TOUCHING, self.end_depths.get(pair, 0.0) + _DEEPER) for pair, depth in ends.items())


def relation_to_region(region: Region, prism: Prism, center: tuple[float, float]) -> RegionRelation:
    """How an object stands to a region."""
    if len(prism.outline) < 3 or len(region.outline) < 3:
        return RegionRelation(False, False)
    return RegionRelation(
        touches=bool(signed_outline_gaps(prism.outline, region.outline, _POINT)[0] < -TOUCHING),
        centred=bool(margins_inside_outline(_POINT, region.outline, np.array([center]))[0] >= 0),
    )


_known: WeakKeyDictionary[Library, dict[str, BaseScene]] = WeakKeyDictionary()


def measure_base_scene(instance: TaskInstance, library: Library) -> BaseScene:
    """What is measured of a base instance; remembered. Raises ``SimulationError``: it cannot be set up."""
    known, key = _known.setdefault(library, {}), hash_instance(instance)
    if key not in known:
        if len(known) >= _REMEMBERED:
            known.clear()
        try:
            known[key] = BaseScene(instance, library)
        except SimulationError:
            raise
        except GrsError as error:
            raise SimulationError(error.message, error.remedy) from error
    return known[key]


def read_masses_and_frictions(base: BaseScene) -> Mapping[int, tuple[float, float]]:
    """Kilograms and the coefficient of sliding friction of each object that can move."""
    model: Any = base.world.model
    return {
        number: (
            float(model.body_mass[body]),
            float(model.geom_friction[int(model.body_geomadr[body]), 0]),
        )
        for number, body in base.world.bodies.items()
        if number in base.world.addresses
    }
