"""Where goals want objects, as rectangles on the table: enough to tell how far an object has still to go."""

from dataclasses import dataclass

from grs_agents.base import Pose
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.goal import Goal
from grs_agents.tasks.envs.task_episode import TaskEpisode


@dataclass(frozen=True)
class Place:
    """A place that will do for an object: a rectangle at a pose, and how far from it is near enough (m)."""

    pose: Pose
    half: tuple[float, float] = (0.0, 0.0)  # of the rectangle's extents, metres
    slack: float = 1e-9
    beside: int | None = None  # id of the object that the rectangle is fixed to, at its centre


def find_goal_places_per_object(episode: TaskEpisode) -> dict[int, list[Place]]:
    """The places for each object, by its id, in the order in which the goals speak of them.

    An object that several goals speak of is wanted where the last wants it. Goals without a place (``upright``,
    ``aligned``) have none.
    """
    last: dict[int, list[Place]] = {}
    for goal in episode.task.grs.stated:
        for index, number in enumerate(goal.objects):
            if found := _places_in_goal(goal, index, episode.env, episode.task.pos_eps):
                last[number] = found
    return last


def _places_in_goal(goal: Goal, index: int, env: Environment, pos_eps: float) -> list[Place]:
    width = min(env.get_object_size(goal.objects[index])[:2])
    if goal.metric == "pose":
        return [Place(goal.targets[one], slack=pos_eps) for one in goal.allowed_target_indices(index)]
    if goal.metric == "zone":
        return [
            Place(zone.pose, _half_extents_of_free_room((zone.size[0], zone.size[1]), width)) for zone in goal.zones
        ]
    if goal.relation_kind == "stacked":
        return [_place_in_or_on_object(goal.objects[index - 1], width, env)] if index else []
    if goal.relation_kind in ("aligned", "upright"):
        return []
    number = goal.reference_id
    if goal.relation_kind == "near":
        apart = (goal.required_distance or 0.0) + (width + min(env.get_object_size(number)[:2])) / 2
        return [Place(env.get_object_pose(number), slack=apart, beside=number)]
    return [_place_in_or_on_object(number, width, env)]


def _place_in_or_on_object(number: int, width: float, env: Environment) -> Place:
    """In or on another object, for something so wide (m)."""
    x, y, _ = env.get_object_size(number)
    return Place(env.get_object_pose(number), _half_extents_of_free_room((x, y), width), beside=number)


def _half_extents_of_free_room(size: tuple[float, float], width: float) -> tuple[float, float]:
    """Half extents of where the middle of something ``width`` wide may be in a rectangle, metres."""
    x, y = (max(side - width, side / 4) / 2 for side in size)
    return x, y
