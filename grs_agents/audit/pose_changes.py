"""Which objects do not stand where the photo shows them, and whether there is a reason for it that can be measured."""

import math
from collections.abc import Sequence

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
"""And within this angle of how it stands there. A turn about the vertical that cannot be seen does not count: any of
what is round, a quarter of a cube's."""
_HALF = math.sqrt(0.5)
_TURNS: tuple[Quat, ...] = ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, _HALF, _HALF), (0.0, 0.0, -_HALF, _HALF))
"""Half a turn about the own z axis, and a quarter to either side."""


def find_pose_changes(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> list[Change]:
    """Every object position that was not taken from the photo; each place in the photo is taken once."""
    return [change for instance in instances for change in _find_pose_changes_of_instance(instance, scene, library)]


def _find_pose_changes_of_instance(instance: TaskInstance, scene: SceneDescription, library: Library) -> list[Change]:
    free = list(scene.objects)
    changes: list[Change] = []
    for item in instance.task_objects:
        places = [place for place in free if place.asset == item.asset]
        nearest = min(places, key=lambda place: math.dist(place.position, item.pose[0]), default=None)
        if nearest is not None and _has_photo_pose(item, nearest, library):
            free.remove(nearest)
            continue
        changes.append(
            Change(
                seed=instance.seed,
                asset=item.asset,
                position=item.pose[0],
                photo=None if nearest is None else nearest.position,
                distance=None if nearest is None else math.dist(nearest.position, item.pose[0]),
                turned=None if nearest is None else math.degrees(_angle_between(nearest.orientation, item.pose[1])),
                reason="" if nearest is None else _explain_why_not_at_photo_pose(nearest, scene),
            )
        )
    return changes


def _explain_why_not_at_photo_pose(place: SceneObject, scene: SceneDescription) -> str:
    """Why an object need not stand where the photo shows it; empty where it can stand there and be moved."""
    if not place.reachable:
        return "is out of reach"
    if place.held or (place.drift or 0.0) > SAME_PLACE:
        return "would not stay as it stands"
    return "is covered" if is_object_covered_in_photo(place, scene) else ""


def is_object_covered_in_photo(place: SceneObject, scene: SceneDescription) -> bool:
    """Whether something lies on an object of the photo, or in it."""
    return any(relation.reference == place.name and relation.kind != "touching" for relation in scene.relations)


def _has_photo_pose(item: InstanceObject, place: SceneObject, library: Library) -> bool:
    """Whether an object stands as the photo shows it, or as that comes to rest, which is what the authors are told."""
    shown = [pose for pose in ((place.position, place.orientation), place.settled) if pose]
    alike = [item.pose[1], *_list_turns_that_look_alike(item, library)]
    return any(_is_same_pose((item.pose[0], turn), pose, place.round) for pose in shown for turn in alike)


def _is_same_pose(one: Pose, other: Pose, any_yaw: bool) -> bool:
    turned = is_tilted(one, other) if any_yaw else _angle_between(one[1], other[1]) > SAME_TILT
    return math.dist(one[0], other[0]) <= SAME_PLACE and not turned


def _list_turns_that_look_alike(item: InstanceObject, library: Library) -> list[Quat]:
    """The orientations in which an object looks as it does in its own, as far as they differ from that by a half or a
    quarter turn about its own z axis.
    """
    if item.asset not in library:
        return []
    model = load_object_model(item, library)
    return [
        transforms.multiply_quaternions(item.pose[1], turn)
        for turn in _TURNS
        if looks_unchanged_by_rotation(model, turn)
    ]


def _angle_between(one: Quat, other: Quat) -> float:
    """The angle of the rotation from one orientation to another, rad."""
    return 2 * math.acos(min(1.0, abs(sum(a * b for a, b in zip(one, other, strict=True)))))


def is_tilted(one: Pose, other: Pose) -> bool:
    """Whether two poses differ in tilt by more than ``SAME_TILT``."""
    cosine = sum(a * b for a, b in zip(_object_up_axis(one[1]), _object_up_axis(other[1]), strict=True))
    return math.acos(max(-1.0, min(1.0, cosine))) > SAME_TILT


def _object_up_axis(quaternion: Quat) -> tuple[float, float, float]:
    """The object's own z axis in the robot frame."""
    x, y, z, w = quaternion
    return (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
