"""Goals as programs state them: checked, in one shape, and in CLIPort's order of fields."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from grs_agents.base import Pose
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.world.tabletop import as_pose, is_number, is_vector


def make_goal(
    objs: Any,
    matches: Any,
    targ_poses: Any,
    replace: bool,
    rotations: bool,
    metric: str,
    params: Any,
    step_max_reward: float,
    symmetries: Any,
) -> Goal:
    """Check the arguments of ``Task.add_goal`` and bring them into one shape.

    Raises:
        SimulationError: an argument does not fit; the message says which, and what would.
    """
    reward = _reward(step_max_reward)
    if isinstance(objs, Goal):
        return objs.model_copy(update={"max_reward": reward})
    numbers, own_symmetries = _objects(objs)
    if metric not in ("pose", "zone"):
        raise SimulationError(f"add_goal: metric {metric!r} is unknown", "use 'pose' or 'zone'")
    targets = _poses(targ_poses)
    zones = _zones(params) if metric == "zone" else []
    if metric == "pose" and not targets:
        raise SimulationError("add_goal: metric 'pose' needs target poses, targ_poses is empty", "give targ_poses")
    if metric == "zone" and not targets:
        targets = [zone.pose for zone in zones]
    return Goal.model_construct(
        objects=tuple(numbers),
        matches=_matches(matches, len(numbers), len(targets)),
        targets=tuple(targets),
        replace=bool(replace),
        rotations=bool(rotations),
        metric="zone" if metric == "zone" else "pose",
        zones=tuple(zones),
        max_reward=reward,
        symmetries=_symmetries(symmetries, own_symmetries),
    )


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


def doubts(objs: Any, matches: Any, targ_poses: Any, metric: str, params: Any, symmetries: Any) -> list[str]:
    """What ``make_goal`` has to assume about arguments that do not quite fit, one sentence each."""
    if isinstance(objs, Goal):
        return []
    count, found = len(_objects(objs)[0]), list[str]()
    targets = len(_poses(targ_poses)) or (len(_zones(params)) if metric == "zone" else 0)
    shape = np.shape(matches)
    if matches is not None and shape != (count, targets):
        found.append(f"matches of shape {shape} was taken for {count} objects and {targets} targets")
    given = count if symmetries is None else np.atleast_1d(np.asarray(symmetries, dtype=object)).shape[0]
    if given not in (1, count):
        found.append(f"{given} symmetries for {count} objects: the last one serves for the others")
    if _has_negative_zone(metric, params):
        found.append("a zone size with negative lengths was taken without their sign")
    return [f"add_goal: {doubt}" for doubt in found]


def _objects(objs: Any) -> tuple[list[int], list[float]]:
    try:
        items: list[Any] = [objs] if is_number(objs) or _is_pair(objs) else list(objs)
    except TypeError as error:
        raise SimulationError(f"add_goal: objs is {objs!r}", "give ids that env.add_object returned") from error
    if not items:
        raise SimulationError("add_goal: objs is empty", "name at least one object id")
    pairs = [_object(item) for item in items]
    return [number for number, _ in pairs], [symmetry for _, symmetry in pairs]


def _reward(value: Any) -> float:
    try:
        reward = float(value)
    except (TypeError, ValueError):
        reward = np.nan
    if not np.isfinite(reward) or reward < 0:
        raise SimulationError(
            f"add_goal: step_max_reward is {value!r}"[:200], "give a share of 1, e.g. 1 / len(objects)"
        )
    return reward


def _is_pair(item: Any) -> bool:
    """Whether something is CLIPort's ``(id, (symmetry, None))`` rather than several ids."""
    return isinstance(item, tuple) and len(cast(tuple[Any, ...], item)) == 2 and not is_number(item[1])


def _object(item: Any) -> tuple[int, float]:
    """An id and its symmetry, from an id or from CLIPort's ``(id, (symmetry, None))``; ``(id, pose)`` has none."""
    symmetry, number = 0.0, item
    if isinstance(item, tuple):
        number, detail = cast(tuple[Any, Any], item)
        first = detail if is_number(detail) else detail[0]
        symmetry = float(first) if is_number(first) else 0.0
    if not isinstance(number, int | np.integer) or isinstance(number, bool):
        raise SimulationError(f"add_goal: objs holds {number!r}", "give ids that env.add_object returned")
    return int(cast(int, number)), symmetry


def _poses(targ_poses: Any) -> list[Pose]:
    if targ_poses is None or len(targ_poses) == 0:
        return []
    bare_pose = len(targ_poses) == 2 and is_vector(targ_poses[0], 3) and is_vector(targ_poses[1], 4)
    if bare_pose or is_vector(targ_poses, 3):
        return [as_pose(targ_poses, "add_goal: targ_poses")]
    return [as_pose(pose, "add_goal: targ_poses") for pose in targ_poses]


def _zones(params: Any) -> list[Zone]:
    entries = list(cast(Sequence[Any], params)) if isinstance(params, list | tuple) else []
    if len(entries) == 2 and isinstance(entries[0], dict):
        return _zones(entries[1])  # CLIPort's (object points, zones): the points are sampled here
    if len(entries) == 2 and is_vector(entries[1], 2, 3):
        return [_zone(entries)]
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
    size = (float(extents[0]), float(extents[1]), height)
    return Zone.model_construct(pose=as_pose(entry[0], "add_goal: zone"), size=size)


def _has_negative_zone(metric: str, params: Any) -> bool:
    """Whether a zone's size is negative along an axis, as the difference of unordered box corners is."""
    if metric != "zone":
        return False
    entries = params[1] if len(params) == 2 and isinstance(params[0], dict) else params
    bare = len(entries) == 2 and is_vector(entries[1], 2, 3)
    sizes = [entries[1]] if bare else [entry[1] for entry in entries]
    return any(bool((np.asarray(size, dtype=np.float64) < 0).any()) for size in sizes)


def _matches(matches: Any, objects: int, targets: int) -> tuple[tuple[int, ...], ...]:
    """Rows and columns too many are cut off, columns too few are zeros, a flat list is a row or a column."""
    if matches is None:
        return ((1,) * targets,) * objects
    array = np.asarray(matches, dtype=np.float64)
    if array.ndim != 2 and array.size == objects * targets:
        array = array.reshape(objects, targets)
    if array.ndim != 2 or array.shape[0] < objects or not array.shape[1]:
        raise SimulationError(
            f"add_goal: matches has shape {array.shape} for {objects} objects and {targets} targets",
            f"give np.ones(({objects}, {targets})) or another array of that shape",
        )
    found = np.zeros((objects, targets), dtype=np.int64)
    kept = array[:objects, :targets]
    found[:, : kept.shape[1]] = kept > 0
    return tuple(map(tuple, found.tolist()))


def _symmetries(symmetries: Any, own: Sequence[float]) -> tuple[float, ...]:
    if symmetries is None:
        return tuple(own)
    given: list[Any] = [symmetries] if is_number(symmetries) else list(symmetries)
    try:
        values = [float(value if is_number(value) else value[0]) for value in given]
    except (TypeError, ValueError, IndexError):
        values = []
    if not values or not np.isfinite(values).all():
        raise SimulationError(
            f"add_goal: symmetries {symmetries!r} for {len(own)} objects",
            "give one angle in 0..2 pi radians for each object (0 = any yaw)",
        )
    values = [float(np.clip(value, 0.0, 2 * np.pi)) for value in values]
    return tuple((values + values[-1:] * len(own))[: len(own)])
