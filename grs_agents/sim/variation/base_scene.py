"""Measurements of a base instance, shared by all of its variations: contacts, reach, relations to marks and zones."""

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
from grs_agents.sim.goals.planning_scene import PlanningScene
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.goals.strict_score import match_rows_to_targets
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance, hash_instance
from grs_agents.sim.motion.placement import APPROACH
from grs_agents.sim.rollouts import score_goals_by_latest_mention
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.tabletop_episode import InstanceTask, change_instance
from grs_agents.sim.variation.rigid_groups import (
    Place,
    RigidGroup,
    find_rigid_groups,
    prisms_of_objects,
)
from grs_agents.sim.world.compilation import compile_world, reset_world_to_poses
from grs_agents.sim.world.footprints import (
    Prism,
    find_nearby_prisms,
    find_prisms_at_pose,
    margins_inside_outline,
    outline_of_zone,
    signed_outline_gaps,
)
from grs_agents.sim.world.spec import instance_to_spec, load_object_model

Pair = tuple[int, int]
"""Ids of two objects in ascending order; -1 is the arm or the background."""
TOUCHING: Final = 0.0005
"""Penetration up to which objects count as apart, metres: side-by-side contacts are no deeper."""
_DEEPER: Final = 0.001
_SHIFT, _SINK, _TILT = 0.02, 0.03, np.deg2rad(15)
"""Motion while settling, sideways and in height (m) and in rotation (rad), above which an object was not stable."""
_CLEAR: Final = 0.04
"""Clearance of a carried object over all others, metres."""
_RISES: Final = np.arange(0.0, 0.62, 0.02)
_POINT: Final = np.zeros((1, 2))
_REMEMBERED: Final = 8
_ENDLESS: Final = 10**12
"""Simulated steps: the same table serves all variations."""


@dataclass(frozen=True)
class AreaRelation:
    """Relation of an object to a mark or a zone, seen from above."""

    touches: bool
    centred: bool


@dataclass(frozen=True)
class MarkedArea:
    """A mark, or the zone of a goal: which objects are on it must not change."""

    outline: FloatArray
    owner: int  # the mark's id, -1 for a zone without a mark


def _sorted_pair(a: int, b: int) -> Pair:
    return (min(a, b), max(a, b))


def _prisms_overlap(a: Prism, b: Prism) -> bool:
    upwards = min(a.high, b.high) - max(a.low, b.low)
    return upwards > TOUCHING and signed_outline_gaps(a.outline, b.outline, _POINT)[0] < -TOUCHING


class BaseScene:
    """A task instance with its compiled world and measurements. Raises ``GrsError`` if it cannot be set up."""

    def __init__(self, instance: TaskInstance, library: Library) -> None:
        self.instance, self.library = instance, library
        self._sim = TabletopSim(library, seed=instance.seed, budget=_ENDLESS, robot=instance.robot, hand=instance.hand)
        task = self._settle_instance(instance)
        ids = {settled: number for number, settled in task.ids.items()}
        scene = PlanningScene(self._sim, task.grs.stated, task.goals)
        self.arm = self._sim.arm
        self.groups = find_rigid_groups(instance, library, scene, ids)
        self.scores = score_goals_by_latest_mention(task)
        self.restless = frozenset(self._find_objects_moved_by_settling(instance, task))
        self.world = compile_world(instance_to_spec(instance, library))
        self.models = {item.id: load_object_model(item, library) for item in instance.objects}
        self._table = int(self.world.model.geom("table").id)
        self.end_depths = self.contact_depths(self.objects_at_goals(instance.objects, instance.goals))
        origin: Pose = ((0.0, 0.0, 0.0), transforms.IDENTITY)
        self._background: list[Prism] = []
        if instance.background is not None:
            model = library.load_object_model(instance.background)
            self._background = find_prisms_at_pose(model, origin, -1)[0]
        prisms = prisms_of_objects(instance, library)
        solid = [prism.high for number, prism in prisms.items() if self.models[number].colliders]
        self._highest_solid_point = max(solid, default=0.0)
        self.ceilings = {
            group: self._lift_heights_needed(group, instance.objects, instance.goals) for group in self.groups
        }
        centers = {item.id: (item.pose[0][0], item.pose[0][1]) for item in instance.objects}
        self.standings = {
            (index, number): relation_to_area(area, prisms[number], centers[number])
            for index, area in enumerate(self.marked_areas(instance.objects, instance.goals))
            for number in prisms
        }

    def _settle_instance(self, instance: TaskInstance) -> InstanceTask:
        """Set up an instance and let it settle on the shared table."""
        episode = change_instance(self._sim, instance)
        episode.reset()
        return episode.task

    def _find_objects_moved_by_settling(self, instance: TaskInstance, task: InstanceTask) -> list[int]:
        """Ids of the objects that settling moves away from their poses in the instance."""
        moved: list[int] = []
        for item in instance.objects:
            (x, y, z), turn = self._sim.get_object_pose(task.ids[item.id])
            (x0, y0, z0), turn0 = item.pose
            away = np.hypot(x - x0, y - y0) > _SHIFT or abs(z - z0) > _SINK
            if away or transforms.angle_between(turn, turn0) > _TILT:
                moved.append(item.id)
        return moved

    def explain_bad_start(self, instance: TaskInstance) -> str:
        """Reason why an episode cannot begin: failed setup, unstable objects, or goals met from the start; else ""."""
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
        """Penetration depth (m) of each pair of bodies, unless both are fixed, by exact contacts; without the
        table top."""
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
    def _base_fixed_overlap_pairs(self) -> frozenset[Pair]:
        return frozenset(
            _sorted_pair(a.owner, b.owner)
            for a, b in combinations(self._list_fixed_prisms(self.instance.objects), 2)
            if a.owner != b.owner and _prisms_overlap(a, b)
        )

    def _list_fixed_prisms(self, objects: Sequence[InstanceObject]) -> list[Prism]:
        fixed = [item for item in objects if item.id not in self.world.addresses]
        prisms = [prism for item in fixed for prism in find_prisms_at_pose(self.models[item.id], item.pose, item.id)[0]]
        return prisms + self._background

    def objects_at_goals(self, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> tuple[InstanceObject, ...]:
        """The objects, those of pose goals at their targets, as far as the goals determine them."""
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

    def marked_areas(self, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> list[MarkedArea]:
        """Marks on the table, and zones that belong to no group; always in the same order."""
        marks = [
            MarkedArea(find_prisms_at_pose(self.models[item.id], item.pose, item.id)[1].outline, item.id)
            for item in objects
            if not self.models[item.id].colliders
        ]
        owned: set[Place] = {place for group in self.groups for place in group.zones}
        return marks + [
            MarkedArea(outline_of_zone(zone), -1)
            for number, goal in enumerate(goals)
            for index, zone in enumerate(goal.zones)
            if (number, index) not in owned
        ]

    def _lift_heights_needed(
        self, group: RigidGroup, objects: Sequence[InstanceObject], goals: Sequence[Goal]
    ) -> FloatArray:
        """Lift heights (N,; m) that the arm reaches at each place of a group, 0 out of reach, clipped to the need.

        Movable objects, and the centres of targets and zones, need clearance over all other objects; the corners of
        zones need the approach alone.
        """
        size = {item.id: self.models[item.id].size[2] for item in objects}
        over, tips = self._highest_solid_point + _CLEAR, list[tuple[float, float, float, float]]()
        for item in objects:
            if item.id in group.objects and item.id in self.world.addresses:
                x, y, z = item.pose[0]
                tips.append((x, y, max(0.0, z + size[item.id] / 2), size[item.id] + over))
        for number, index in sorted(group.targets):
            (x, y, z), tall = goals[number].targets[index][0], max(size[member] for member in goals[number].objects)
            tips.append((x, y, z + tall / 2, tall + over))
        for number, index in sorted(group.zones):
            zone, tall = goals[number].zones[index], max(size[member] for member in goals[number].objects)
            tips.append((*zone.pose[0][:2], tall, tall + over))
            tips += [(float(x), float(y), tall, tall + APPROACH) for x, y in outline_of_zone(zone)]
        if not tips:
            return np.zeros(0)
        places = np.array(tips)
        heights = np.minimum(places[:, 2:3] + _RISES, places[:, 3:])
        grid = np.concatenate([np.repeat(places[:, None, :2], len(_RISES), axis=1), heights[:, :, None]], axis=2)
        served = self.arm.reachable_mask(grid.reshape(-1, 3)).reshape(heights.shape)
        return np.where(np.logical_and.accumulate(served, axis=1), heights, 0.0).max(axis=1)

    def keeps_lift_height(self, group: RigidGroup, objects: Sequence[InstanceObject], goals: Sequence[Goal]) -> bool:
        """Whether the arm lifts as high at each place of a group as it did in the base."""
        return bool((self._lift_heights_needed(group, objects, goals) >= self.ceilings[group] - 1e-9).all())

    def keeps_support_relations(
        self, group: RigidGroup, objects: Sequence[InstanceObject], goals: Sequence[Goal]
    ) -> bool:
        """Whether no object has come onto or off a mark or a zone by the move of a group."""
        prisms = {item.id: find_prisms_at_pose(self.models[item.id], item.pose, item.id)[1] for item in objects}
        centers = {item.id: item.pose[0][:2] for item in objects}
        for index, area in enumerate(self.marked_areas(objects, goals)):
            moved = area.owner in group.objects
            for number in (prisms.keys() - group.objects) if moved else group.objects:
                if number == area.owner:
                    continue
                before, now = self.standings[index, number], relation_to_area(area, prisms[number], centers[number])
                if now.centred != before.centred or (now.touches and not before.touches):
                    return False
        return True

    def keeps_clear_of_others(
        self, group: RigidGroup, objects: Sequence[InstanceObject], goals: Sequence[Goal]
    ) -> bool:
        """Whether a group touches nothing else, and the targets of pose goals are still free.

        MuJoCo does not collide fixed objects: these are compared by upright prisms, apart from overlaps of the base.
        """
        for (first, second), depth in self.contact_depths(objects).items():
            if depth > TOUCHING and (first in group.objects) != (second in group.objects):
                return False
        prisms = self._list_fixed_prisms(objects)
        others = [prism for prism in prisms if prism.owner not in group.objects]
        for moved in (prism for prism in prisms if prism.owner in group.objects):
            for other in find_nearby_prisms(moved, others, (0.0, 0.0), 0.0):
                pair = _sorted_pair(moved.owner, other.owner)
                if pair not in self._base_fixed_overlap_pairs and _prisms_overlap(moved, other):
                    return False
        ends = self.contact_depths(self.objects_at_goals(objects, goals))
        return all(depth <= max(TOUCHING, self.end_depths.get(pair, 0.0) + _DEEPER) for pair, depth in ends.items())


def relation_to_area(area: MarkedArea, prism: Prism, center: tuple[float, float]) -> AreaRelation:
    """Relation of an object to an area."""
    if len(prism.outline) < 3 or len(area.outline) < 3:
        return AreaRelation(False, False)
    return AreaRelation(
        touches=bool(signed_outline_gaps(prism.outline, area.outline, _POINT)[0] < -TOUCHING),
        centred=bool(margins_inside_outline(_POINT, area.outline, np.array([center]))[0] >= 0),
    )


_known: WeakKeyDictionary[Library, dict[str, BaseScene]] = WeakKeyDictionary()


def measure_base_scene(instance: TaskInstance, library: Library) -> BaseScene:
    """The measured base instance, cached. Raises ``SimulationError`` if it cannot be set up."""
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
    """Mass (kg) and coefficient of sliding friction of each movable object."""
    model: Any = base.world.model
    return {
        number: (
            float(model.body_mass[body]),
            float(model.geom_friction[int(model.body_geomadr[body]), 0]),
        )
        for number, body in base.world.bodies.items()
        if number in base.world.addresses
    }
