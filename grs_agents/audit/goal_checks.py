"""Checks of goals: each object has a goal; no goal holds at the start, on most of the table or for next to no reward;
moves are long and tolerate an inaccurate hand."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from grs_agents.audit.types import AuditFinding
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rollouts import HAND_NOISE, Rollout
from grs_agents.sim.world.footprints import (
    Prism,
    distance_between_outlines,
    margins_inside_outline,
    object_prism_at_pose,
    outline_of_zone,
)
from grs_agents.sim.world.spec import is_movable, load_object_model

IDLE: Final = 0.05
"""Doing nothing earns at most this share of the reward: a rounded score, not an object that is at its goal already."""
MOVE: Final = 0.05
"""Least visible move (m); a shorter move is a nudge."""
NUDGE: Final = 0.04
"""Least move (m) that a goal requires, beside its tolerance; goals of honest tasks need at least 0.048."""
TURN: Final = math.radians(30)
"""Least turn (rad) of a goal that asks for the yaw."""
TABLE_SHARE: Final = 0.4
"""A goal that holds on more than this share of the table asks for next to nothing; marks of honest tasks take 0.31."""
WORKSPACE: Final = 0.5
"""Area of the table in front of the robot, m^2."""
FAIR_SHARE: Final = 0.5
"""A goal is worth at least this share of an even part of the reward, by goals or by objects; honest tasks have 1."""
SURE_HAND: Final = 0.8
"""Share of the episodes with the least noise of the hand that must be solved."""
MAY_STAY: Final[Mapping[str, int]] = {"stacked": 1, "aligned": 2}
"""Objects of a relation that need not move: a stack's lowest, and the two ends of a line."""
_POSE_TOLERANCE: Final = 0.01
"""Metres by which a pose goal may be missed anyway."""
_LIFTED: Final = 0.05
"""Height difference (m) from which a move along the table cannot reach a target."""
_ORIGIN: Final = np.zeros((1, 2))


def list_goal_findings(
    instances: Sequence[TaskInstance],
    rollouts: Sequence[Rollout],
    library: Library,
    scene: SceneDescription | None,
    least: float,
) -> list[AuditFinding]:
    """Findings about the goals of all instances; ``least`` is the score (0..1) that counts as solved."""
    pairs = pair_instances_with_rollouts(instances, rollouts)
    findings = [
        check_goals_open_at_start(instances, rollouts),
        check_goal_area_is_limited(instances, library),
        check_objects_move_far_enough(pairs, library),
        check_fair_rewards(instances),
        check_solved_despite_hand_noise(rollouts, least),
    ]
    return [check_objects_have_goals(pairs, library, scene), *findings] if scene is not None else findings


def pair_instances_with_rollouts(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout]
) -> list[tuple[TaskInstance, Rollout]]:
    """Pair each instance with its rollout; instances without a rollout are left out."""
    by_seed = {rollout.seed: rollout for rollout in rollouts}
    return [(instance, by_seed[instance.seed]) for instance in instances if instance.seed in by_seed]


def asset_with_id(instance: TaskInstance, number: int) -> str:
    """The asset name and the id of an object of an instance."""
    return f"{next(item.asset for item in instance.objects if item.id == number)} #{number}"


def check_objects_have_goals(
    pairs: Sequence[tuple[TaskInstance, Rollout]], library: Library, scene: SceneDescription
) -> AuditFinding:
    """Every object that a task adds to a photo has a purpose, since unused objects are bystanders anyway.

    An asset that the photo shows needs a goal even if the program adds it as fixed.
    """
    shown = {item.asset for item in scene.objects}
    without: list[str] = []
    for instance, rollout in pairs:
        needed = {item.id for item in instance.task_objects if item.asset in shown or is_movable_object(item, library)}
        # An added fixed object needs a goal, too, if no object of the photo starts, ends or is to end over it.
        shown_ids = [item.id for item in instance.task_objects if item.asset in shown]
        places = [
            poses[number][0] for poses in (rollout.initial, rollout.final) for number in shown_ids if number in poses
        ]
        for goal in instance.goals:
            places += [pose[0] for pose in (*goal.targets, *(zone.pose for zone in goal.zones))]
        points = np.array([place[:2] for place in places]).reshape(-1, 2)
        for item in instance.task_objects:
            if item.asset not in shown and item.asset in library:
                outline = object_prism_at_pose(load_object_model(item, library), item.pose, item.id).outline
                if not (margins_inside_outline(_ORIGIN, outline, points) >= -MOVE).any():
                    needed.add(item.id)
        mentioned = {number for goal in instance.goals for number in goal.mentioned_object_ids}
        without += [
            f"no goal speaks of {asset_with_id(instance, number)}"
            for number in sorted(needed - mentioned - set(rollout.neighbours))
        ]
    otherwise = "goals speak of every object that is movable or in the photo"
    bound = "each object that the task adds and that is movable or in the photo must have a goal, or be what a goal "
    bound += "refers to; what the task does not use stands there anyway"
    return AuditFinding.from_fault_list("objects_have_goals", without, otherwise, bound)


def is_movable_object(item: InstanceObject, library: Library) -> bool:
    """True for an object that is neither fixed nor a mark."""
    return item.asset in library and is_movable(item, library.load_object_model(item.asset))


def check_goals_open_at_start(instances: Sequence[TaskInstance], rollouts: Sequence[Rollout]) -> AuditFinding:
    """The finding ``not_idle``: doing nothing earns next to nothing, and meets no goal."""
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
    return AuditFinding(
        check="not_idle",
        passed=bool(rewards) and max(rewards) <= IDLE and not met,
        measured="; ".join([measured, *met[:4]]),
        bound=f"it must earn at most {IDLE}, and meet no goal",
    )


def check_goal_area_is_limited(instances: Sequence[TaskInstance], library: Library) -> AuditFinding:
    """The finding ``goals_narrow``: share of the table on which a goal holds, from its targets, zones and distances."""
    shares: list[tuple[float, int]] = []  # 0..1, and the goal's number
    for instance in instances:
        for index, goal in enumerate(instance.goals, 1):
            area = 0.0
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
            shares.append((min(1.0, area / WORKSPACE), index))
    widest, index = max(shares, default=(0.0, 0))
    return AuditFinding(
        check="goals_narrow",
        passed=widest <= TABLE_SHARE,
        measured=f"goal {index} holds on {widest:.0%} of the table" if index else "there are no goals",
        bound=f"a goal may hold on at most {TABLE_SHARE:.0%} of it",
    )


def check_objects_move_far_enough(pairs: Sequence[tuple[TaskInstance, Rollout]], library: Library) -> AuditFinding:
    """The finding ``moves_far``: the oracle moves or turns every object visibly, and no nudge would do.

    The objects in ``MAY_STAY`` may be moved too little. A nudge that meets a goal of an object counts in its last goal.
    """
    short: list[str] = []
    nudged: list[str] = []
    for instance, rollout in pairs:
        if rollout.episode.outcome != "success":
            continue
        for index, goal in enumerate(instance.goals, 1):
            later = {number for later_goal in instance.goals[index:] for number in later_goal.objects}
            moves: list[tuple[int, float]] = []  # id and metres of the objects that moved too little
            for row, number in enumerate(goal.objects):
                if number not in rollout.final:
                    continue
                start, end = rollout.initial[number], rollout.final[number]
                asks_yaw = goal.metric == "pose" and goal.rotations and goal.symmetries[row] > 0
                turned = goal.relation_kind == "upright" or asks_yaw
                turned = turned and transforms.angle_between(start[1], end[1]) >= TURN
                way = math.dist(start[0], end[0])
                if way < MOVE and not turned:
                    moves.append((number, way))
                if number in later:
                    continue
                least = _measure_least_move(goal, row, instance, rollout, library)
                if least < NUDGE and not turned:
                    name = asset_with_id(instance, number)
                    nudged.append(f"goal {index} would hold if {name} were moved by {max(0.0, least) * 100:.1f} cm")
            for number, way in sorted(moves, key=lambda move: move[1])[MAY_STAY.get(goal.relation_kind or "", 0) :]:
                short.append(f"goal {index} moves {asset_with_id(instance, number)} by {way * 100:.1f} cm")
    short += nudged
    bound = f"an object must be moved by {MOVE * 100:.0f} cm, its goal not hold {NUDGE * 100:.0f} cm from its start, "
    bound += f"or it be turned by {math.degrees(TURN):.0f} degrees where its goal asks for a yaw"
    faults = short if pairs else ["there is no episode"]
    otherwise = "the oracle moves the objects of every goal farther"
    return AuditFinding.from_fault_list("moves_far", faults, otherwise, bound)


def check_fair_rewards(instances: Sequence[TaskInstance]) -> AuditFinding:
    """The finding ``fair_rewards``: no goal is worth much less than an even part of the reward."""
    short: list[str] = []
    for goals in (instance.goals for instance in instances):
        objects = sum(len(goal.objects) for goal in goals)
        for number, goal in enumerate(goals, 1):
            even = min(1 / len(goals), len(goal.objects) / max(objects, 1))
            if goal.max_reward < FAIR_SHARE * even:
                short.append(f"goal {number} is worth {goal.max_reward:.3f}, an even part is {even:.3f}")
    bound = f"each goal must be worth {FAIR_SHARE:.0%} of its even part of the reward, by goals or by objects"
    return AuditFinding.from_fault_list("fair_rewards", short, "no goal is worth much less than the others", bound)


def check_solved_despite_hand_noise(rollouts: Sequence[Rollout], least: float) -> AuditFinding:
    """The finding ``sure_hand``: the oracle solves the task although its hand misses each pose by some millimetres."""
    trials = [trial for rollout in rollouts for trial in rollout.trials]
    solved = {noise: [trial.score >= least for trial in trials if trial.noise == noise] for noise in HAND_NOISE}
    tried = {noise: results for noise, results in solved.items() if results}
    first = tried.get(HAND_NOISE[0], [])
    measured = "the oracle solved no instance, so none was tried with noise of the hand"
    if tried:
        counts = [f"{sum(results)} of {len(results)} with {noise * 1000:.0f} mm" for noise, results in tried.items()]
        halved = [noise for noise, results in tried.items() if 2 * sum(results) < len(results)]
        edge = f"fewer than half at {halved[0] * 1000:.0f} mm" if halved else "at least half with all of these"
        measured = f"with a hand that misses by up to so much the oracle solves {', '.join(counts)}; {edge}"
    return AuditFinding(
        check="sure_hand",
        passed=bool(first) and sum(first) >= SURE_HAND * len(first),
        measured=measured,
        bound=f"{SURE_HAND:.0%} must be solved with {HAND_NOISE[0] * 1000:.0f} mm",
    )


def _measure_least_move(goal: Goal, row: int, instance: TaskInstance, rollout: Rollout, library: Library) -> float:
    """Least distance (m) along the table that an object must move for its goal to hold.

    The oracle may move it farther. Returns: an upper bound; infinite if no move along the table can do.
    """
    if goal.metric == "pose":
        start = rollout.initial[goal.objects[row]][0]
        ends = [goal.targets[index][0] for index in goal.allowed_target_indices(row)]
        ways = [math.dist(start[:2], end[:2]) if abs(start[2] - end[2]) < _LIFTED else math.inf for end in ends]
        return min(ways, default=math.inf) - max(0.0, instance.pos_eps - _POSE_TOLERANCE)
    prism = _compute_object_prism_at_start(goal.objects[row], instance, rollout, library)
    if goal.metric == "zone":
        return min(_distance_to_fit_inside(prism, outline_of_zone(zone)) for zone in goal.zones)
    if goal.relation_kind == "aligned" and goal.required_distance is None:
        # The best line goes through two of the centres; the largest residual counts.
        points = np.array([rollout.initial[number][0][:2] for number in goal.objects])
        least = math.inf
        for start, end in combinations(points, 2):
            x, y = end - start
            length = float(np.hypot(x, y))
            if length > _POSE_TOLERANCE:
                residuals = np.abs(x * (points[:, 1] - start[1]) - y * (points[:, 0] - start[0])) / length
                least = min(least, float(residuals.max()))
        return least
    if goal.relation_kind not in ("near", "in_zone") or any(
        goal.reference_id in stated.objects for stated in instance.goals
    ):
        return math.inf
    reference = _compute_object_prism_at_start(goal.reference_id, instance, rollout, library)
    if goal.relation_kind == "in_zone":
        return _distance_to_fit_inside(prism, reference.outline)
    return distance_between_outlines(prism.outline, reference.outline) - (goal.required_distance or 0.0)


def _distance_to_fit_inside(prism: Prism, around: FloatArray) -> float:
    return max(0.0, -float(margins_inside_outline(prism.outline, around, _ORIGIN)[0]))


def _compute_object_prism_at_start(number: int, instance: TaskInstance, rollout: Rollout, library: Library) -> Prism:
    item = next(item for item in instance.objects if item.id == number)
    return object_prism_at_pose(load_object_model(item, library), rollout.initial[number], number)
