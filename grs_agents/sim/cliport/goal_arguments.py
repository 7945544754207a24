"""Goals from the arguments of programs: validation and normalisation, in CLIPort's order of fields."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from grs_agents.base import Pose
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.tabletop import is_number, is_vector, parse_pose

_METRICS = {"zone_with_z_match": "zone"}
"""Of LoHo-Ravens, whose heights the strict score asks for anyway."""


@dataclass(frozen=True)
class GoalArguments:
    """Arguments of `make_goal` from a program; its lists may grow until ``reset`` ends."""

    objs: Any
    matches: Any
    targ_poses: Any
    replace: bool
    rotations: bool
    metric: str
    params: Any
    step_max_reward: float
    symmetries: Any

    @property
    def may_still_be_filled(self) -> bool:
        """Whether a list is still empty, so that the program may fill it later."""
        return any(isinstance(given, list) and not given for given in (self.objs, self.targ_poses, self.params))

    def make_goal(self) -> tuple[Goal, list[str]]:
        """The goal that the arguments state now; returns as `make_goal`."""
        given = (self.objs, self.matches, self.targ_poses, self.replace, self.rotations, self.metric, self.params)
        return make_goal(*given, self.step_max_reward, self.symmetries)


UNSTATED = Goal.model_construct(objects=(), targets=(), matches=(), zones=(), max_reward=0.0)
"""Placeholder for a goal whose lists are still empty."""


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
) -> tuple[Goal, list[str]]:
    """The goal of the arguments of ``Task.add_goal``, and a sentence for each assumption made about them.

    Raises ``SimulationError``, which names the argument that does not fit, and a remedy.
    """
    try:
        reward = float(step_max_reward)
    except (TypeError, ValueError):
        reward = np.nan
    if not np.isfinite(reward) or reward < 0:
        raise SimulationError(
            f"add_goal: step_max_reward is {step_max_reward!r}"[:200], "give a share of 1, e.g. 1 / len(objects)"
        )
    if isinstance(objs, Goal):
        rest = {"matches": matches, "targ_poses": targ_poses, "params": params, "symmetries": symmetries}
        return objs.model_copy(update={"max_reward": reward}), [
            f"task.add_goal: {name} had no effect, a typed goal says all by itself"
            for name, value in rest.items()
            if value is not None
        ]
    pairs = _parse_ids_and_symmetries(objs)
    metric = _METRICS.get(metric, metric)
    if metric not in ("pose", "zone"):
        raise SimulationError(f"add_goal: metric {metric!r} is unknown", "use 'pose' or 'zone'")
    if targ_poses is None or len(targ_poses) == 0:
        poses: list[Any] = []
    elif is_vector(targ_poses, 3) or (
        len(targ_poses) == 2 and is_vector(targ_poses[0], 3) and is_vector(targ_poses[1], 4)
    ):
        poses = [targ_poses]  # a bare pose
    else:
        poses = list(targ_poses)
    targets: list[Pose] = [parse_pose(pose, "add_goal: targ_poses") for pose in poses]
    entries = _list_zone_entries(params) if metric == "zone" else []
    zones = tuple(map(_parse_zone, entries))
    if metric == "pose" and not targets:
        raise SimulationError("add_goal: metric 'pose' needs target poses, targ_poses is empty", "give targ_poses")
    goal = Goal.model_construct(
        objects=tuple(number for number, _ in pairs),
        matches=_parse_match_matrix(matches, len(pairs), len(targets or zones)),
        targets=tuple(targets) or tuple(zone.pose for zone in zones),
        replace=bool(replace),
        rotations=bool(rotations),
        metric=metric,
        zones=zones,
        max_reward=reward,
        symmetries=_parse_symmetries(symmetries, [symmetry for _, symmetry in pairs]),
    )
    assumed: list[str] = []
    count, places = len(goal.objects), len(goal.targets)
    if matches is not None and np.shape(matches) != (count, places):
        assumed.append(f"matches of shape {np.shape(matches)} was taken for {count} objects and {places} targets")
    given = count if symmetries is None else np.atleast_1d(np.asarray(symmetries, dtype=object)).shape[0]
    if given not in (1, count):
        assumed.append(f"{given} symmetries for {count} objects: the last one serves for the others")
    if any((np.asarray(zone[1], dtype=np.float64) < 0).any() for zone in entries):
        assumed.append("a zone size with negative lengths was taken without their sign")
    return goal, [f"add_goal: {note}" for note in assumed]


def states_no_object(fields: Any) -> bool:
    """Whether a tuple in ``task.goals`` names no object, as when no object has the colour that a program looks for."""
    listed = cast(Sequence[Any], fields) if isinstance(fields, tuple | list) else ()
    return len(listed) == 8 and isinstance(listed[0], list) and not listed[0]


def convert_to_goal(fields: Any) -> Goal:
    """A goal from ``task.goals``: a goal or CLIPort's tuple of eight; raises ``SimulationError`` for anything else."""
    if isinstance(fields, Goal):
        return fields
    if not isinstance(fields, tuple | list) or len(cast(Sequence[Any], fields)) != 8:
        raise SimulationError(
            f"task.goals holds {fields!r}"[:200],
            "append (objs, matches, targ_poses, replace, rotations, metric, params, step_max_reward), or use add_goal",
        )
    objs, matches, targets, replace, rotations, metric, params, reward = cast(Sequence[Any], fields)
    return make_goal(objs, matches, targets, replace, rotations, metric, params, reward, None)[0]


def _parse_ids_and_symmetries(objs: Any) -> list[tuple[int, float]]:
    """Ids of a goal's objects with their symmetries, from ids or CLIPort's ``(id, (symmetry, None))``."""
    given = cast(tuple[Any, ...], objs) if isinstance(objs, tuple) else ()
    try:
        single = is_number(objs) or (len(given) == 2 and not is_number(given[1]))
        items: list[Any] = [objs] if single else list(cast(Any, objs))
    except TypeError as error:
        raise SimulationError(f"add_goal: objs is {objs!r}", "give ids that env.add_object returned") from error
    if not items:
        raise SimulationError("add_goal: objs is empty", "name at least one object id")
    pairs: list[tuple[int, float]] = []
    for item in items:
        symmetry, number = 0.0, item
        if isinstance(item, tuple):
            number, detail = cast(tuple[Any, Any], item)
            first = detail if is_number(detail) else detail[0]
            symmetry = float(first) if is_number(first) else 0.0  # ``(id, pose)`` has none
        if not isinstance(number, int | np.integer) or isinstance(number, bool):
            raise SimulationError(f"add_goal: objs holds {number!r}", "give ids that env.add_object returned")
        pairs.append((int(cast(int, number)), symmetry))
    return pairs


def _list_zone_entries(params: Any) -> list[Any]:
    """Entries of a program's zones, each a pair of pose and size."""
    entries = list(cast(Sequence[Any], params)) if isinstance(params, list | tuple) else []
    if len(entries) == 2 and isinstance(entries[0], dict):
        return _list_zone_entries(entries[1])  # CLIPort's (object points, zones): the points are sampled here
    if not entries:
        raise SimulationError("add_goal: metric 'zone' needs params", "give params=[(zone_pose, zone_size)]")
    return [entries] if len(entries) == 2 and is_vector(entries[1], 2, 3) else entries


def _parse_zone(entry: Any) -> Zone:
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
    return Zone.model_construct(pose=parse_pose(entry[0], "add_goal: zone"), size=size)


def _parse_match_matrix(matches: Any, objects: int, targets: int) -> tuple[tuple[int, ...], ...]:
    """Match matrix of the right shape: surplus rows and columns are cut off, missing columns are zeros, missing rows
    repeat the last, a flat list is a row or a column."""
    if matches is None:
        return ((1,) * targets,) * objects
    array = np.asarray(matches, dtype=np.float64)
    if array.ndim != 2 and array.size == objects * targets:
        array = array.reshape(objects, targets)
    if array.ndim != 2 or not array.size:
        raise SimulationError(
            f"add_goal: matches has shape {array.shape} for {objects} objects and {targets} targets",
            f"give np.ones(({objects}, {targets})) or another array of that shape",
        )
    if array.shape != (objects, targets):
        array = np.pad(array[:objects, :targets], ((0, max(objects - len(array), 0)), (0, 0)), "edge")
        array = np.pad(array, ((0, 0), (0, targets - array.shape[1])))
    return tuple(map(tuple, (array > 0).astype(np.int64).tolist()))


def _parse_symmetries(symmetries: Any, defaults: Sequence[float]) -> tuple[float, ...]:
    if symmetries is None:
        return tuple(defaults)
    given: list[Any] = [symmetries] if is_number(symmetries) else list(symmetries)
    try:
        values = [float(value if is_number(value) else value[0]) for value in given]
    except (TypeError, ValueError, IndexError):
        values = []
    if not values or not np.isfinite(values).all():
        raise SimulationError(
            f"add_goal: symmetries {symmetries!r} for {len(defaults)} objects",
            "give one angle in 0..2 pi radians for each object (0 = any yaw)",
        )
    values = [float(np.clip(value, 0.0, 2 * np.pi)) for value in values]
    return tuple((values + values[-1:] * len(defaults))[: len(defaults)])
