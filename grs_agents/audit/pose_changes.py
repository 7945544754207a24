"""Objects that are not at their pose in the photo, and the measured reason if there is one."""

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
"""Half a turn about the own z axis, and a quarter to either side."""


def find_pose_changes(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> list[Change]:
    """Every object position that was not taken from the photo; each place in the photo is taken once."""
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
                measured = {
                    "photo": nearest.position,
                    "distance": math.dist(nearest.position, item.pose[0]),
                    "turned": math.degrees(_angle_between(nearest.orientation, item.pose[1])),
                    "reason": _explain_why_not_at_photo_pose(nearest, scene),
                }
                change = change.model_copy(update=measured)
            changes.append(change)
    return changes


def _explain_why_not_at_photo_pose(place: SceneObject, scene: SceneDescription) -> str:
    """Reason why an object may leave its pose in the photo; empty if it can stay there and be moved."""
    if not place.reachable:
        return "is out of reach"
    if place.held or (place.drift or 0.0) > SAME_PLACE:
        return "would not stay as it stands"
    return "is covered" if is_object_covered_in_photo(place, scene) else ""


def is_object_covered_in_photo(place: SceneObject, scene: SceneDescription) -> bool:
    """Whether the photo shows anything on the object, or in it."""
    return any(relation.reference == place.name and relation.kind != "touching" for relation in scene.relations)


def _has_photo_pose(item: InstanceObject, place: SceneObject, library: Library) -> bool:
    """Whether an object has the pose of the photo, or the pose in which that comes to rest, which the authors are
    given."""
    shown = [pose for pose in ((place.position, place.orientation), place.settled) if pose]
    alike = [item.pose[1]]
    if item.asset in library:
        model = load_object_model(item, library)
        turns = [turn for turn in _TURNS if looks_unchanged_by_rotation(model, turn)]
        alike += [transforms.multiply_quaternions(item.pose[1], turn) for turn in turns]
    for pose, turn in product(shown, alike):
        turned = is_tilted((item.pose[0], turn), pose) if place.round else _angle_between(turn, pose[1]) > SAME_TILT
        if math.dist(item.pose[0], pose[0]) <= SAME_PLACE and not turned:
            return True
    return False


def _angle_between(start: Quat, end: Quat) -> float:
    """Angle (rad) of the rotation between two orientations."""
    return 2 * math.acos(min(1.0, abs(sum(a * b for a, b in zip(start, end, strict=True)))))


def is_tilted(start: Pose, end: Pose) -> bool:
    """Whether two poses differ in tilt by more than ``SAME_TILT``."""
    cosine = sum(a * b for a, b in zip(_object_up_axis(start[1]), _object_up_axis(end[1]), strict=True))
    return math.acos(max(-1.0, min(1.0, cosine))) > SAME_TILT


def _object_up_axis(quaternion: Quat) -> tuple[float, float, float]:
    """The object's own z axis in the robot frame."""
    x, y, z, w = quaternion
    return (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
