"""Bystanders: the objects of the photo in and near the workspace, on the table of all tasks of its scene."""

import math
import re
from collections.abc import Mapping
from typing import Any, Final

from grs_agents.graph.services import Services
from grs_agents.library.library import Library
from grs_agents.perception import types
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.goals.scores import DISTURBED
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.pick_trials import explain_unpickable_objects, find_objects_overlapping_robot
from grs_agents.sim.tabletop_episode import open_instance_episode
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from grs_agents.sim.world.footprints import object_prism_at_pose
from grs_agents.sim.world.spec import TIMESTEP

_MARGIN: Final = 0.15
"""Margin around the workspace, metres: the arm sweeps over objects there, and containers at the edge reach over."""
_WATCHED: Final = 500
"""Steps after the scene has settled: 2 s, so that creep shows."""


def photo_objects(scene: SceneDescription, library: Library) -> tuple[InstanceObject, ...]:
    """The objects of the photo within the workspace and 15 cm around it, as bystanders in their poses at rest.

    Objects that may stand on something unseen are fixed; objects that intersect the robot are left out.
    """
    near: dict[int, SceneObject] = {}
    for number, item in enumerate(scene.objects, FIRST_BYSTANDER):
        (west, south, _), (east, north, _) = item.box.low, item.box.high
        within_x = east > types.X[0] - _MARGIN and west < types.X[1] + _MARGIN
        within_y = north > types.Y[0] - _MARGIN and south < types.Y[1] + _MARGIN
        if within_x and within_y and not item.stands_in_robot:
            near[number] = item
    placed = [PlacedObject(item.asset, item.settled or (item.position, item.orientation)) for item in near.values()]
    return tuple(
        item.model_copy(update={"id": number, "role": "bystander", "category": "fixed" if seen.held else "rigid"})
        for (number, seen), item in zip(near.items(), to_instance_objects(placed, library), strict=True)
    )


def program_tool_settings(scene: SceneDescription | None, services: Services) -> dict[str, Any]:
    """The fields of the request of a tool that runs programs: asset folders, arm, background and bystanders.

    There are no bystanders without a photo, or if the configuration leaves them out.
    """
    around = scene if services.config.scene.bystanders else None
    return {
        "background": scene.background if scene is not None else None,
        "bystanders": () if around is None else photo_objects(around, services.library),
        "robot": services.robot_name_or_path,
        "hand": services.config.hand,
        **services.library_root_fields,
    }


def prepare_scene_for_tasks(
    scene: SceneDescription, library: Library, robot: str, hand: str = DEFAULT_HAND
) -> SceneDescription:
    """Fit the scene to the world of its tasks, which has the arm and the background, and in which objects may roll.

    Objects that intersect the robot are left out. Objects that do not stay are held in the air, the lowest first: an
    object that rests in the twin may fall there. Then the robot tries to pick each object, and the scene records why it
    cannot.

    Raises:
        SimulationError: MuJoCo takes the scene for impossible.
    """
    while True:
        items = photo_objects(scene, library)
        instance = TaskInstance(
            task="",
            seed=0,
            max_steps=1,
            timestep=TIMESTEP,
            goals=(),
            objects=items,
            background=scene.background,
            robot=robot,
            hand=hand,
        )
        episode = open_instance_episode(instance, library)
        episode.reset()
        sim = episode.sim
        if within := find_objects_overlapping_robot(sim):
            changes = {number: {"stands_in_robot": True, "reachable": False} for number in within}
            scene = _update_objects_by_id(scene, changes)
            continue
        sim.step_simulation(_WATCHED)
        moved = [item for item in items if math.dist(item.pose[0], sim.get_object_pose(item.id)[0]) > DISTURBED]
        if not moved:
            break
        lowest = min(moved, key=lambda item: object_prism_at_pose(sim.object_model(item.id), item.pose).low)
        scene = _update_objects_by_id(scene, {lowest.id: {"held": True}})
    names = {label: scene.objects[number - FIRST_BYSTANDER].name for number, label in sim.object_labels.items()}
    labels = re.compile("|".join(map(re.escape, sorted(names, key=len, reverse=True))) or "(?!)")
    changes: dict[int, dict[str, Any]] = {}
    for number, reason in explain_unpickable_objects(sim, episode.task).items():
        trouble = labels.sub(lambda label: names[label.group()], reason)
        item = scene.objects[number - FIRST_BYSTANDER]
        if item.is_doubtful:
            trouble = item.pick_trouble if trouble in item.pick_trouble else f"{item.pick_trouble}; {trouble}"
        changes[number] = {"pick_trouble": trouble}
    return _update_objects_by_id(scene, changes)


def _update_objects_by_id(scene: SceneDescription, changes: Mapping[int, Mapping[str, Any]]) -> SceneDescription:
    """Copy the scene with changed fields of some objects, by their ids as bystanders."""
    objects = tuple(
        item.model_copy(update=changes.get(number, {})) for number, item in enumerate(scene.objects, FIRST_BYSTANDER)
    )
    twin = scene.twin and scene.twin.model_copy(update={"held": sum(item.held for item in objects)})
    return scene.model_copy(update={"objects": objects, "twin": twin})
