"""What the photo shows in and near the workspace: it stands on the table of every task of the scene."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from grs_agents.graph.services import Services
from grs_agents.library.library import Library
from grs_agents.perception import types
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.pick_trials import explain_unpickable_objects, find_objects_overlapping_robot
from grs_agents.sim.rollouts import InstanceTask
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from grs_agents.sim.world.footprints import object_prism_at_pose
from grs_agents.sim.world.spec import TIMESTEP

_MARGIN: Final = 0.15
"""So near to the workspace the arm sweeps over things, and containers at its edge reach over to them, metres."""
_STAYS: Final = 0.01
"""What moves by no more than this stays, metres: the bound on bystanders at the end of an episode."""
_WATCHED: Final = 500
"""Steps after the scene has settled: 2 s, so that what creeps shows."""


def photo_objects(scene: SceneDescription, library: Library) -> tuple[InstanceObject, ...]:
    """The objects of the photo within the workspace and 15 cm around it, as bystanders where they came to rest.

    What may stand on something unseen is fixed; what stands where the robot does is left out.
    """
    near = {FIRST_BYSTANDER + index: item for index, item in enumerate(scene.objects) if _is_near_workspace(item)}
    placed = [PlacedObject(item.asset, item.settled or (item.position, item.orientation)) for item in near.values()]
    return tuple(
        item.model_copy(update={"id": number, "role": "bystander", "category": "fixed" if one.held else "rigid"})
        for (number, one), item in zip(near.items(), to_instance_objects(placed, library), strict=True)
    )


def configured_bystanders(scene: SceneDescription | None, services: Services) -> tuple[InstanceObject, ...]:
    """What stands around the tasks of a run: nothing without a photo, or if the configuration leaves it out."""
    if scene is None or not services.config.scene.bystanders:
        return ()
    return photo_objects(scene, services.library)


def program_tool_settings(scene: SceneDescription | None, services: Services) -> dict[str, Any]:
    """What a tool is told that runs programs: where the assets are, the arm, and what is around the task."""
    background = scene.background if scene is not None else None
    around = {"background": background, "bystanders": configured_bystanders(scene, services)}
    return {**around, "robot": services.robot_name_or_path, **services.library_root_fields}


def _is_near_workspace(item: SceneObject) -> bool:
    (west, south, _), (east, north, _) = item.box.low, item.box.high
    within_x = east > types.X[0] - _MARGIN and west < types.X[1] + _MARGIN
    return not item.stands_in_robot and within_x and north > types.Y[0] - _MARGIN and south < types.Y[1] + _MARGIN


def prepare_scene_for_tasks(scene: SceneDescription, library: Library, robot: str) -> SceneDescription:
    """The scene as the world of its tasks bears it, which has the arm and the background, and where things roll.

    What stands where the robot does is left out. What does not stay is held in the air, the lowest first: what rests in
    the twin may fall there. Then the robot tries to pick each object, and the scene tells what it cannot.

    Raises:
        SimulationError: MuJoCo takes the scene for impossible.
    """
    while True:
        items = photo_objects(scene, library)
        env = _set_up_world(items, scene, library, robot)
        if within := find_objects_overlapping_robot(env):
            scene = _update_objects_by_id(
                scene, {number: {"stands_in_robot": True, "reachable": False} for number in within}
            )
            continue
        env.step_simulation(_WATCHED)
        unstable = _lowest_unstable_object(items, env)
        if unstable is None:
            return _update_objects_by_id(scene, _explain_unpickable_by_number(scene, env))
        scene = _update_objects_by_id(scene, {unstable: {"held": True}})


def _set_up_world(
    items: Sequence[InstanceObject], scene: SceneDescription, library: Library, robot: str
) -> Environment:
    fields = {"task": "", "seed": 0, "max_steps": 1, "timestep": TIMESTEP, "goals": ()}
    around = {"objects": items, "background": scene.background, "robot": robot}
    instance = TaskInstance.model_validate({**fields, **around})
    env = Environment(library=library, task=InstanceTask(instance), robot=instance.robot)
    env.reset()
    return env


def _lowest_unstable_object(items: Sequence[InstanceObject], env: Environment) -> int | None:
    """The id of the object that has moved by more than 1 cm though nothing acts, and of several the lowest; or None."""
    moved = [one for one in items if math.dist(one.pose[0], env.get_object_pose(one.id)[0]) > _STAYS]
    lowest = min(moved, key=lambda one: object_prism_at_pose(env.object_model(one.id), one.pose).low, default=None)
    return None if lowest is None else lowest.id


def _explain_unpickable_by_number(scene: SceneDescription, env: Environment) -> dict[int, dict[str, Any]]:
    """Of each object that the robot cannot pick, why, with the names of the scene."""
    names = {label: scene.objects[number - FIRST_BYSTANDER].name for number, label in env.object_labels.items()}
    labels = re.compile("|".join(map(re.escape, sorted(names, key=len, reverse=True))) or "(?!)")
    return {
        number: {"pick_trouble": labels.sub(lambda found: names[found.group()], why)}
        for number, why in explain_unpickable_objects(env).items()
    }


def _update_objects_by_id(scene: SceneDescription, changes: Mapping[int, Mapping[str, Any]]) -> SceneDescription:
    """The scene with other values of some objects, by their ids as bystanders."""
    objects = tuple(
        item.model_copy(update=changes.get(FIRST_BYSTANDER + index, {})) for index, item in enumerate(scene.objects)
    )
    twin = scene.twin and scene.twin.model_copy(update={"held": sum(item.held for item in objects)})
    return scene.model_copy(update={"objects": objects, "twin": twin})
