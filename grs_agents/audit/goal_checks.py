"""Checks of goals: each object has one, none holds at the start or almost anywhere or for next to no reward, moves are
far and not too fine."""

import math
from collections.abc import Mapping, Sequence, Set
from typing import Final

import numpy as np

from grs_agents.audit.least_moves import measure_least_move
from grs_agents.audit.types import Finding
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import HAND_NOISE, Rollout
from grs_agents.sim.world.footprints import margins_inside_outline, object_prism_at_pose
from grs_agents.sim.world.spec import load_object_model

IDLE: Final = 0.05
"""Doing nothing earns at most this share of the reward: a rounded score, not an object that is at its goal already."""
MET: Final = 0.985
"""A goal holds from this score on, as the oracle and the strict score have it."""
MOVE: Final = 0.05
"""Metres: people see that something was moved so far, and call less a nudge."""
NUDGE: Final = 0.04
"""Metres: goals of honest tasks need 0.048 at the least, beside what a pose may be missed by."""
TURN: Final = math.radians(30)
"""Or turned by this much, where a goal asks for the yaw."""
TABLE_SHARE: Final = 0.4
"""A goal that holds on more than this share of the table asks for next to nothing; marks of honest tasks take 0.31."""
WORKSPACE: Final = 0.5
"""Area of the table in front of the robot, m^2."""
FAIR_SHARE: Final = 0.5
"""A goal is worth at least this share of an even part of the reward, by goals or by objects; honest tasks have 1."""
SURE_HAND: Final = 0.8
"""Share of the episodes with the least noise of the hand that must be solved."""


def list_goal_findings(
    instances: Sequence[TaskInstance],
    rollouts: Sequence[Rollout],
    library: Library,
    scene: SceneDescription | None,
    least: float,
) -> list[Finding]:
    """Findings about the goals of all instances; ``least`` is the score (0..1) that counts as solved."""
    pairs = pair_instances_with_rollouts(instances, rollouts)
    findings = [
        _check_goals_open_at_start(instances, rollouts),
        _check_goal_area_is_limited(instances, library),
        _check_objects_move_far_enough(pairs, library),
        _check_fair_rewards(instances),
        _check_solved_despite_hand_noise(rollouts, least),
    ]
    return [_check_objects_have_goals(pairs, library, scene), *findings] if scene is not None else findings


def pair_instances_with_rollouts(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout]
) -> list[tuple[TaskInstance, Rollout]]:
    """Each instance with its rollout, where it has one."""
    by_seed = {rollout.seed: rollout for rollout in rollouts}
    return [(instance, by_seed[instance.seed]) for instance in instances if instance.seed in by_seed]


def asset_with_id(instance: TaskInstance, number: int) -> str:
    """The asset name and the id of an object of an instance."""
    return f"{next(item.asset for item in instance.objects if item.id == number)} #{number}"


def _check_objects_have_goals(
    pairs: Sequence[tuple[TaskInstance, Rollout]], library: Library, scene: SceneDescription
) -> Finding:
    """Of a task from a photo: what it does not use stands there as a bystander, so all that it adds has a purpose.

    What the photo shows must have one even where the program adds it as fixed.
    """
    shown = {item.asset for item in scene.objects}
    without = [
        f"no goal speaks of {asset_with_id(instance, number)}"
        for instance, rollout in pairs
        for number in _find_objects_without_purpose(instance, rollout, library, shown)
    ]
    otherwise = "goals speak of every object that is movable or in the photo"
    bound = "each object that the task adds and that is movable or in the photo must have a goal, or be what a goal "
    bound += "refers to; what the task does not use stands there anyway"
    return Finding.from_fault_list("objects_have_goals", without, otherwise, bound)


def _find_objects_without_purpose(
    instance: TaskInstance, rollout: Rollout, library: Library, shown: Set[str]
) -> set[int]:
    added = {item.id for item in instance.task_objects if item.asset in shown or is_movable_object(item, library)}
    named = {number for goal in instance.goals for number in goal.mentioned_object_ids}
    purposeless = added - named - set(rollout.neighbours)
    return purposeless | (
        _find_unused_fixed_objects(instance, rollout, library, shown) - named - set(rollout.neighbours)
    )


def _find_unused_fixed_objects(instance: TaskInstance, rollout: Rollout, library: Library, shown: Set[str]) -> set[int]:
    """Fixed things that the photo does not show, and over which nothing of the task starts, ends or is to end."""
    points, here = _collect_task_positions(instance, rollout, shown), np.zeros((1, 2))
    return {
        item.id
        for item in instance.task_objects
        if item.asset not in shown and item.asset in library
        if not (margins_inside_outline(here, _object_outline_from_above(item, library), points) >= -MOVE).any()
    }


def _collect_task_positions(instance: TaskInstance, rollout: Rollout, shown: Set[str]) -> FloatArray:
    """(N, 2) where the task's objects of the photo start and end, and where goals want things, metres."""
    own = [item.id for item in instance.task_objects if item.asset in shown]
    places = [poses[number][0] for poses in (rollout.initial, rollout.final) for number in own if number in poses]
    for goal in instance.goals:
        places += [pose[0] for pose in (*goal.targets, *(zone.pose for zone in goal.zones))]
    return np.array([place[:2] for place in places]).reshape(-1, 2)


def _object_outline_from_above(item: InstanceObject, library: Library) -> FloatArray:
    return object_prism_at_pose(load_object_model(item, library), item.pose, item.id).outline


def is_movable_object(item: InstanceObject, library: Library) -> bool:
    """Whether an object can be moved: it is not fixed, and no mark."""
    known = item.asset in library
    return item.category != "fixed" and known and bool(library.load_object_model(item.asset).colliders)


def _check_goals_open_at_start(instances: Sequence[TaskInstance], rollouts: Sequence[Rollout]) -> Finding:
    rewards = [rollout.idle_reward for rollout in rollouts]
    met = [
        f"goal {index + 1} is met in seed {rollout.seed}"
        for rollout in rollouts
        for index, score in enumerate(rollout.idle_scores)
        if score >= MET
    ]
    shown = ", ".join(f"{reward:.2f}" for reward in rewards) or "none"
    seconds = max((rollout.idle_seconds for rollout in rollouts), default=0.0)
    measured = f"doing nothing for as long as the oracle takes ({seconds:.0f} s) earns {shown}"
    if 1.0 in rewards:
        measured += " (1 also where the scene stays in motion)"
    return Finding(
        check="not_idle",
        passed=bool(rewards) and max(rewards) <= IDLE and not met,
        measured="; ".join([measured, *met[:4]]),
        bound=f"it must earn at most {IDLE}, and meet no goal",
    )


def _check_goal_area_is_limited(instances: Sequence[TaskInstance], library: Library) -> Finding:
    shares = [
        (_table_share_satisfying_goal(goal, instance, library), index + 1)
        for instance in instances
        for index, goal in enumerate(instance.goals)
    ]
    widest, index = max(shares, default=(0.0, 0))
    return Finding(
        check="goals_narrow",
        passed=widest <= TABLE_SHARE,
        measured=f"goal {index} holds on {widest:.0%} of the table" if index else "there are no goals",
        bound=f"a goal may hold on at most {TABLE_SHARE:.0%} of it",
    )


def _table_share_satisfying_goal(goal: Goal, instance: TaskInstance, library: Library) -> float:
    """On how much of the table an object of a goal may lie, as the goal's targets, zones and distances say; 0..1."""
    if goal.metric == "pose":
        area = len({target[0][:2] for target in goal.targets}) * math.pi * instance.pos_eps**2
    elif goal.metric == "zone":
        area = sum(zone.size[0] * zone.size[1] for zone in goal.zones)
    elif goal.relation_kind in ("near", "in_zone"):
        item = next(item for item in instance.objects if item.id == goal.reference_id)
        shapes = library.load_filled_template(item.asset, item.fill) if item.fill else None
        size = (shapes or library.load_object_model(item.asset)).size if item.asset in library else (0.0, 0.0)
        around = 2 * goal.required_distance if goal.required_distance is not None else 0.0
        area = (size[0] + around) * (size[1] + around)
    else:
        area = 0.0
    return min(1.0, area / WORKSPACE)


def _check_objects_move_far_enough(pairs: Sequence[tuple[TaskInstance, Rollout]], library: Library) -> Finding:
    short = [
        f"goal {index + 1} moves {asset_with_id(instance, number)} by {away * 100:.1f} cm"
        for instance, rollout in pairs
        if rollout.episode.outcome == "success"
        for index, goal in enumerate(instance.goals)
        for number, away in _find_short_moves(goal, rollout)
    ]
    short += [
        f"goal {index + 1} would hold if {asset_with_id(instance, number)} were moved by {max(0.0, least) * 100:.1f} cm"
        for instance, rollout in pairs
        if rollout.episode.outcome == "success"
        for index in range(len(instance.goals))
        for number, least in _find_short_required_moves(index, instance, rollout, library)
    ]
    bound = f"an object must be moved by {MOVE * 100:.0f} cm, its goal not hold {NUDGE * 100:.0f} cm from its start, "
    bound += f"or it be turned by {math.degrees(TURN):.0f} degrees where its goal asks for a yaw"
    faults = short if pairs else ["there is no episode"]
    return Finding.from_fault_list("moves_far", faults, "the oracle moves the objects of every goal farther", bound)


def _find_short_moves(goal: Goal, rollout: Rollout) -> list[tuple[int, float]]:
    """(id, metres) of the objects of a goal that moved too little; those that need not move at all are left out.

    A stack's lowest object may stay, and two of a line.
    """
    may_stay = {"stacked": 1, "aligned": 2}.get(goal.relation_kind or "", 0)
    short: list[tuple[int, float]] = []
    for row, number in enumerate(goal.objects):
        if number not in rollout.final:
            continue
        start, end = rollout.initial[number], rollout.final[number]
        away = math.dist(start[0], end[0])
        if away < MOVE and not _is_turned_as_asked(goal, row, rollout):
            short.append((number, away))
    return sorted(short, key=lambda one: one[1])[may_stay:]


def _is_turned_as_asked(goal: Goal, row: int, rollout: Rollout) -> bool:
    """Whether the oracle turned an object far, as its goal asks."""
    asked = goal.relation_kind == "upright" or (goal.metric == "pose" and goal.rotations and goal.symmetries[row] > 0)
    number = goal.objects[row]
    return asked and transforms.angle_between(rollout.initial[number][1], rollout.final[number][1]) >= TURN


def _find_short_required_moves(
    index: int, instance: TaskInstance, rollout: Rollout, library: Library
) -> list[tuple[int, float]]:
    """(id, metres) of the objects of a goal that a nudge would bring there; of one in several goals the last counts."""
    goal, later = instance.goals[index], instance.goals[index + 1 :]
    spoken_of = {number for other in later for number in other.objects}
    rows = [row for row, number in enumerate(goal.objects) if number not in spoken_of and number in rollout.final]
    needed = [(row, measure_least_move(goal, row, instance, rollout, library)) for row in rows]
    return [
        (goal.objects[row], way) for row, way in needed if way < NUDGE and not _is_turned_as_asked(goal, row, rollout)
    ]


def _check_fair_rewards(instances: Sequence[TaskInstance]) -> Finding:
    """Who reads the reward alone would take a task for done whose last goals are worth next to nothing."""
    short = [
        f"goal {index + 1} is worth {goal.max_reward:.3f}, an even part is {even:.3f}"
        for instance in instances
        for index, (goal, even) in enumerate(
            zip(instance.goals, _compute_even_reward_shares(instance.goals), strict=True)
        )
        if goal.max_reward < FAIR_SHARE * even
    ]
    bound = f"each goal must be worth {FAIR_SHARE:.0%} of its even part of the reward, by goals or by objects"
    return Finding.from_fault_list("fair_rewards", short, "no goal is worth much less than the others", bound)


def _compute_even_reward_shares(goals: Sequence[Goal]) -> list[float]:
    """The part of the reward that each goal has if goals count alike, or if objects do, whichever is less."""
    objects = sum(len(goal.objects) for goal in goals)
    return [min(1 / len(goals), len(goal.objects) / max(objects, 1)) for goal in goals]


def _check_solved_despite_hand_noise(rollouts: Sequence[Rollout], least: float) -> Finding:
    """Whether the task stands on a knife's edge: the oracle's hand misses each pose by up to some millimetres."""
    trials = [trial for rollout in rollouts for trial in rollout.trials]
    solved = {noise: [trial.score >= least for trial in trials if trial.noise == noise] for noise in HAND_NOISE}
    tried = {noise: results for noise, results in solved.items() if results}
    first = tried.get(HAND_NOISE[0], [])
    return Finding(
        check="sure_hand",
        passed=bool(first) and sum(first) >= SURE_HAND * len(first),
        measured=_describe_noise_trials(tried),
        bound=f"{SURE_HAND:.0%} must be solved with {HAND_NOISE[0] * 1000:.0f} mm",
    )


def _describe_noise_trials(tried: Mapping[float, Sequence[bool]]) -> str:
    """How many episodes were solved with each noise (m), and at which fewer than half are."""
    if not tried:
        return "the oracle solved no instance, so none was tried with noise of the hand"
    counts = [f"{sum(results)} of {len(results)} with {noise * 1000:.0f} mm" for noise, results in tried.items()]
    halved = [noise for noise, results in tried.items() if 2 * sum(results) < len(results)]
    edge = f"fewer than half at {halved[0] * 1000:.0f} mm" if halved else "at least half with all of these"
    return f"with a hand that misses by up to so much the oracle solves {', '.join(counts)}; {edge}"
