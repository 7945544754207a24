"""Objects that left their pose in the photo, with the measured reason, if any."""

import math
from collections.abc import Sequence
from itertools import product

from grs_agents.audit.types import Change
from grs_agents.base import Pose, Quat
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.library.shapes import looks_unchanged_by_rotation
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.world.spec import load_object_model

SAME_PLACE = 0.03
"""An object within this many metres of its place in the photo has kept it."""
SAME_TILT = math.radians(15)
"""Tolerance of the orientation in the photo. Invisible turns about the vertical do not count: any turn of a round
object, a quarter of a cube's."""
_HALF = math.sqrt(0.5)
_TURNS: tuple[Quat, ...] = ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, _HALF, _HALF), (0.0, 0.0, -_HALF, _HALF))
"""Half a turn about the object's z axis, and a quarter turn to either side."""


def find_pose_changes(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> list[Change]:
    """List every object pose that was not taken from the photo; each place in the photo is taken once."""
    changes: list[Change] = []
    for instance in instances:
        free = list(scene.objects)
        for item in instance.task_objects:
            change = Change(seed=instance.seed, asset=item.asset, position=item.pose[0], photo=None, distance=None)
            places = [place for place in free if place.asset == item.asset]
            nearest = min(places, key=lambda place: math.dist(place.position, item.pose[0]), default=None)
            if nearest is not None and _has_photo_pose(item, nearest, library):
                free.remove(nearest)
                continue
            if nearest is not None:
                reason = ""
                if not nearest.reachable:
                    reason = "is out of reach"
                elif nearest.held or (nearest.drift or 0.0) > SAME_PLACE:
                    reason = "would not stay as it stands"
                elif is_object_covered_in_photo(nearest, scene):
                    reason = "is covered"
                measured = {
                    "photo": nearest.position,
                    "distance": math.dist(nearest.position, item.pose[0]),
                    "turned": math.degrees(transforms.angle_between(nearest.orientation, item.pose[1])),
                    "wanted": nearest.settled or (nearest.position, nearest.orientation),
                    "reason": reason,
                }
                change = change.model_copy(update=measured)
            changes.append(change)
    return changes


def is_object_covered_in_photo(place: SceneObject, scene: SceneDescription) -> bool:
    """True if the photo shows anything on or in the object."""
    return any(relation.reference == place.name and relation.kind != "touching" for relation in scene.relations)


def _has_photo_pose(item: InstanceObject, place: SceneObject, library: Library) -> bool:
    """True if an object has its pose in the photo, or the settled pose that the authors are given."""
    shown = [pose for pose in ((place.position, place.orientation), place.settled) if pose]
    alike = [item.pose[1]]
    if item.asset in library:
        model = load_object_model(item, library)
        turns = [turn for turn in _TURNS if looks_unchanged_by_rotation(model, turn)]
        alike += [transforms.multiply_quaternions(item.pose[1], turn) for turn in turns]
    for pose, turn in product(shown, alike):
        if place.round:
            turned = is_tilted((item.pose[0], turn), pose)
        else:
            turned = transforms.angle_between(turn, pose[1]) > SAME_TILT
        if math.dist(item.pose[0], pose[0]) <= SAME_PLACE and not turned:
            return True
    return False


def is_tilted(start: Pose, end: Pose) -> bool:
    """True if two poses differ in tilt by more than ``SAME_TILT``."""
    return transforms.angle_between_up_axes(start[1], end[1]) > SAME_TILT
