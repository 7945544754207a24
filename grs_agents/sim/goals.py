"""Goals as programs state them: checked, in one shape, and in CLIPort's order of fields."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.sim import utils
from grs_agents.sim.episode import SimulationError
from grs_agents.sim.relations import Relation

Metric = Literal["pose", "zone", "relation"]
Zone = tuple[Pose, Vec3]
"""Pose of a zone's centre and its full extents, metres."""


class Goal(NamedTuple):
    """One goal; unpacks in CLIPort's order.

    Attributes:
        objs: object ids.
        matches: (objects, targets) zeros and ones.
        targ_poses: target poses.
        replace: objects may share a target.
        rotations: the target's yaw is asked for.
        metric: ``pose``, ``zone`` or ``relation``.
        params: the zones of a ``zone`` goal.
        step_max_reward: reward for the whole goal.
        symmetries: for each object, radians after which it looks the same; 0 = any yaw.
        relation: what a ``relation`` goal asks for; it has no targets.
    """

    objs: list[int]
    matches: npt.NDArray[np.int64]
    targ_poses: list[Pose]
    replace: bool
    rotations: bool
    metric: Metric
    params: list[Zone]
    step_max_reward: float
    symmetries: list[float]
    relation: Relation | None = None


def make_goal(
    objs: Any, matches: Any, targ_poses: Any, replace: bool, rotations: bool, metric: str, params: Any,
    step_max_reward: float, symmetries: Any,
) -> Goal:  # fmt: skip
    """Check the arguments of ``Task.add_goal`` and bring them into one shape.

    Raises:
        SimulationError: an argument does not fit; the message says which, and what would.
    """
    reward = float(step_max_reward)
    if not np.isfinite(reward) or reward < 0:
        raise SimulationError(f"add_goal: step_max_reward is {reward}", "give a share of 1, e.g. 1 / len(objects)")
    if isinstance(objs, Relation):
        return _typed(objs, reward)
    numbers, own_symmetries = _objects(objs)
    if metric not in ("pose", "zone"):
        raise SimulationError(f"add_goal: metric {metric!r} is unknown", "use 'pose' or 'zone'")
    targets = _poses(targ_poses)
    zones = _zones(params) if metric == "zone" else []
    if metric == "pose" and not targets:
        raise SimulationError("add_goal: metric 'pose' needs target poses, targ_poses is empty", "give targ_poses")
    if metric == "zone" and not targets:
        targets = [zone[0] for zone in zones]
    return Goal(
        numbers, _matches(matches, len(numbers), len(targets)), targets, bool(replace), bool(rotations),
        "zone" if metric == "zone" else "pose", zones, reward, _symmetries(symmetries, own_symmetries),
    )  # fmt: skip


def _typed(relation: Relation, reward: float) -> Goal:
    objs = list(relation.objects)
    none = np.zeros((len(objs), 0), dtype=np.int64)
    return Goal(objs, none, [], False, False, "relation", [], reward, [0.0] * len(objs), relation)


def as_goal(fields: Any) -> Goal:
    """A goal, or what a program appended to ``task.goals`` as CLIPort's tuple of eight.

    Raises:
        SimulationError: it is not such a tuple.
    """
    if isinstance(fields, Goal):
        return fields
    if not isinstance(fields, tuple | list) or len(cast(Sequence[Any], fields)) != 8:
        raise SimulationError(
            f"task.goals holds {fields!r}"[:200],
            "append (objs, matches, targ_poses, replace, rotations, metric, params, step_max_reward), or use add_goal",
        )
    objs, matches, targets, replace, rotations, metric, params, reward = cast(Sequence[Any], fields)
    return make_goal(objs, matches, targets, replace, rotations, metric, params, reward, None)


def _objects(objs: Any) -> tuple[list[int], list[float]]:
    items: list[Any] = [objs] if np.isscalar(objs) or isinstance(objs, tuple) else list(objs)
    if not items:
        raise SimulationError("add_goal: objs is empty", "name at least one object id")
    pairs = [_object(item) for item in items]
    return [number for number, _ in pairs], [symmetry for _, symmetry in pairs]


def _object(item: Any) -> tuple[int, float]:
    """An id and its symmetry, from an id or from CLIPort's ``(id, (symmetry, None))``."""
    symmetry = 0.0
    number = item
    if isinstance(item, tuple):
        pair = cast(tuple[Any, Any], item)
        number = pair[0]
        symmetry = float(np.asarray(pair[1], dtype=object).ravel()[0])
    if not isinstance(number, int | np.integer) or isinstance(number, bool):
        raise SimulationError(f"add_goal: objs holds {number!r}", "give ids that env.add_object returned")
    return int(cast(int, number)), symmetry


def as_pose(value: Any, what: str) -> Pose:
    """A pose from a pair of position (m) and quaternion (xyzw).

    Raises:
        SimulationError: it is not such a pair of finite numbers.
    """
    try:
        position = np.asarray(value[0], dtype=np.float64).ravel()
        rotation = np.asarray(value[1] if len(value) > 1 and value[1] is not None else utils.IDENTITY, dtype=np.float64)
    except (TypeError, ValueError, IndexError) as error:
        raise SimulationError(f"{what}: {value!r} is not a pose", "give ((x, y, z), (qx, qy, qz, qw))") from error
    if position.shape != (3,) or rotation.shape != (4,) or not np.isfinite([*position, *rotation]).all():
        raise SimulationError(f"{what}: {value!r} is not a pose", "give ((x, y, z), (qx, qy, qz, qw)), all finite")
    return (utils.vec3(position), utils.quat(rotation))


def _poses(targ_poses: Any) -> list[Pose]:
    if targ_poses is None or len(targ_poses) == 0:
        return []
    if len(targ_poses) == 2 and np.isscalar(targ_poses[0][0]):  # one bare pose
        return [as_pose(targ_poses, "add_goal: targ_poses")]
    return [as_pose(pose, "add_goal: targ_poses") for pose in targ_poses]


def _zones(params: Any) -> list[Zone]:
    entries = list(cast(Sequence[Any], params)) if isinstance(params, list | tuple) else []
    if len(entries) == 2 and isinstance(entries[0], dict):
        return _zones(entries[1])  # CLIPort's (object points, zones): the points are sampled here
    if not entries:
        raise SimulationError("add_goal: metric 'zone' needs params", "give params=[(zone_pose, zone_size)]")
    return [_zone(entry) for entry in entries]


def _zone(entry: Any) -> Zone:
    try:
        extents = np.abs(np.asarray(entry[1], dtype=np.float64).ravel())
    except (TypeError, ValueError, IndexError) as error:
        raise SimulationError(
            f"add_goal: {entry!r} is not a zone", "give params=[(zone_pose, (size_x, size_y, size_z))]"
        ) from error
    if len(extents) not in (2, 3) or not np.isfinite(extents).all() or (extents[:2] <= 0).any():
        raise SimulationError(f"add_goal: zone size {entry[1]!r} is no size in metres", "give (x, y, z)")
    height = float(extents[2]) if len(extents) == 3 else 0.0
    return as_pose(entry[0], "add_goal: zone"), (float(extents[0]), float(extents[1]), height)


def has_negative_zone(metric: str, params: Any) -> bool:
    """Whether a zone's size is negative along an axis, as the difference of unordered box corners is."""
    if metric != "zone":
        return False
    entries = params[1] if len(params) == 2 and isinstance(params[0], dict) else params
    return any(bool((np.asarray(entry[1], dtype=np.float64) < 0).any()) for entry in entries)


def _matches(matches: Any, objects: int, targets: int) -> npt.NDArray[np.int64]:
    array = np.atleast_2d(np.asarray(matches, dtype=np.float64))
    if array.shape != (objects, targets):
        raise SimulationError(
            f"add_goal: matches has shape {array.shape} for {objects} objects and {targets} targets",
            f"give np.ones(({objects}, {targets})) or another array of that shape",
        )
    return (array > 0).astype(np.int64)


def _symmetries(symmetries: Any, own: Sequence[float]) -> list[float]:
    if symmetries is None:
        return list(own)
    values = [float(value) for value in np.atleast_1d(np.asarray(symmetries, dtype=np.float64))]
    if len(values) == 1:
        values = values * len(own)
    if len(values) != len(own) or any(not 0 <= value <= 2 * np.pi + 1e-3 for value in values):
        raise SimulationError(
            f"add_goal: symmetries {symmetries!r} for {len(own)} objects",
            "give one angle in 0..2 pi radians for each object (0 = any yaw)",
        )
    return values
