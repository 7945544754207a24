"""The checks: pure functions from instances and rollouts to findings."""

import re
from collections import Counter
from collections.abc import Sequence

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.goal_checks import is_movable_object, list_goal_findings
from grs_agents.audit.pose_changes import find_pose_changes, is_object_covered_in_photo
from grs_agents.audit.scene_checks import list_scene_findings
from grs_agents.audit.types import AuditReport, Finding
from grs_agents.audit.visibility_checks import check_visibility
from grs_agents.base.config.schema import AuditConfig
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.instance.episode import Episode
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.spec import TIMESTEP

_VARYING = frozenset({"random", "randomly", "shuffled", "varying", "various", "anywhere"})
"""Words of a task that say that its seeds differ."""
GOAL = 0.95
"""Each goal must strictly hold at least so far by itself: one that is worth next to nothing is no excuse."""
_ABOUT_SEVERAL = frozenset({"sure_hand", "seeds_differ"})
"""Checks of all instances together, which a single one says nothing about."""
TABLE_TOP = -0.02
"""What ends lower than this (m) has fallen off the table."""


def audit_task(
    instances: Sequence[TaskInstance],
    failures: Sequence[str],
    rollouts: Sequence[Rollout],
    config: AuditConfig,
    library: Library,
    task: TaskDefinition | None = None,
    scene: SceneDescription | None = None,
    original: TaskDefinition | None = None,
) -> AuditReport:
    """Judge a task from what trusted code measured.

    Args:
        instances: the validated task instances, one for each seed that gave one and gave it twice.
        failures: one line for each seed that gave none, or whose rollout failed.
        rollouts: the trusted oracle's runs of the instances.
        config: the bounds.
        library: tells fixtures from things that must be in the photo.
        task: the definition the program must keep to; ``None`` for a program without one.
        scene: the photo the program must keep to; ``None`` for a program without one.
        original: the definition before the task was revised; ``None`` for one that was not.
    """
    findings = [
        _check_all_seeds_instantiate(instances, failures, config),
        _check_oracle_solves_instances(rollouts, config),
        _check_seeds_differ(instances, task),
        _check_objects_moved(instances, rollouts, scene),
        _check_nothing_fell_off(rollouts),
        _check_assets_known_and_timestep_kept(instances, library),
        *list_goal_findings(instances, rollouts, library, scene, config.reward),
        *list_scene_findings(instances, rollouts, library, scene),
        check_visibility(instances, rollouts, library, scene),
    ]
    if task is not None:
        findings.append(_check_assets_match_task(instances, task))
    if task is not None and original is not None:
        findings.append(_check_revision_keeps_objects(task, original, scene))
    if scene is not None:
        findings.append(_check_assets_are_in_photo(instances, scene, library))
    return AuditReport(
        accepted=all(finding.passed for finding in findings),
        findings=tuple(findings),
        changes=tuple(find_pose_changes(instances, scene, library)) if scene is not None else (),
        rollouts=tuple(rollouts),
        rewards=tuple(rollout.episode.reward for rollout in rollouts),
        about=_describe_verdict_scope(instances),
    )


def check_report_of_unforeseen_seeds(seeds: Sequence[int], drawn: int, report: AuditReport) -> Finding:
    """The finding ``unforeseen``: ``report`` is about the instances of ``seeds``, some of those ``drawn`` that no
    program could know."""
    failed = [one for one in report.findings if not one.passed and one.check not in _ABOUT_SEVERAL]
    audited = f"seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))}"
    return Finding(
        check="unforeseen",
        passed=not failed,
        measured=f"{audited} of {drawn} that follow from the text of the programs: "
        + ("all checks hold" if not failed else "; ".join(f"{one.check}: {one.detail}" for one in failed)),
        bound="what is asked of the other instances is asked of one more, whose seed the program cannot know, and of "
        "those that show another kind of scene",
    )


def _describe_verdict_scope(instances: Sequence[TaskInstance]) -> str:
    seeds = ", ".join(str(instance.seed) for instance in instances) or "none"
    return (
        f"The verdict is about the task instances, of the seeds {seeds}; two processes drew each of them alike. "
        "It is not about the program, which may draw anything for other seeds."
    )


def _check_all_seeds_instantiate(
    instances: Sequence[TaskInstance], failures: Sequence[str], config: AuditConfig
) -> Finding:
    return Finding(
        check="instantiated",
        passed=len(instances) == config.seeds and not failures,
        measured="; ".join([f"{len(instances)} of {config.seeds} seeds gave a task instance", *failures]),
        bound="each must",
    )


def _check_oracle_solves_instances(rollouts: Sequence[Rollout], config: AuditConfig) -> Finding:
    episodes = [rollout.episode for rollout in rollouts]
    scores = (
        ", ".join(f"{episode.strict:.2f} (published {episode.reward:.2f}, {episode.outcome})" for episode in episodes)
        or "none"
    )
    measured = f"strict scores {scores}"
    weakest = min((episode.weakest for episode in episodes), default=0.0)
    if weakest < GOAL:
        measured += f", the weakest goal is at {weakest:.2f}"
    if shortfalls := dict.fromkeys(clause for episode in episodes for clause in episode.shortfalls):
        measured += f"; short of it: {'; '.join(shortfalls)}"
    solved = all(_is_episode_solved(episode, config.reward) for episode in episodes) and weakest >= GOAL
    return Finding(
        check="solved",
        passed=len(episodes) == config.seeds and solved,
        measured=measured,
        bound=f"each of {config.seeds} must reach {config.reward}, and every goal {GOAL}",
    )


def _is_episode_solved(episode: Episode, least: float) -> bool:
    return min(episode.strict, episode.reward) >= least and episode.outcome == "success"


def _check_seeds_differ(instances: Sequence[TaskInstance], task: TaskDefinition | None) -> Finding:
    """Instances that are alike are one; that is a fault only where the task says that something varies."""
    different = len({serialize_instance_without_seed(instance) for instance in instances})
    words = re.findall(r"[a-z]+", task.description.lower()) if task is not None else []
    varying = sorted(_VARYING & set(words))
    return Finding(
        check="seeds_differ",
        passed=different > 1 or len(instances) < 2 or not varying,
        measured=f"{len(instances)} seeds give {different} different task instances",
        bound=f"the task says that something varies ({', '.join(varying)}), so they must differ"
        if varying
        else "the task does not say that they must",
    )


def serialize_instance_without_seed(instance: TaskInstance) -> str:
    """All of an instance but its seed, as text: equal where two are the same task."""
    return instance.model_dump_json(exclude={"seed"})


def _check_objects_moved(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], scene: SceneDescription | None
) -> Finding:
    """A task from a photo moves two of its objects, if two can be; others move two if their goals ask for two."""
    if scene is not None:
        seen = {item.asset for item in scene.objects}
        counts = [sum(name in seen for name in rollout.moved) for rollout in rollouts]
        movable = sum(_can_be_moved(item, scene) for item in scene.objects)
        why = f"{movable} are in reach, uncovered and not held, and the robot can pick them"
    else:
        counts = [len(rollout.moved) for rollout in rollouts]
        movable = min((sum(map(_count_objects_to_move, instance.goals)) for instance in instances), default=0)
        why = f"the goals ask for {movable}"
    needed = max(1, min(2, movable))
    return Finding(
        check="moved",
        passed=bool(counts) and min(counts) >= needed,
        measured=f"objects moved by the robot: {counts}",
        bound=f"at least {needed} must be, {why}",
    )


def _can_be_moved(item: SceneObject, scene: SceneDescription) -> bool:
    return item.reachable and not (item.held or item.pick_trouble or is_object_covered_in_photo(item, scene))


def _count_objects_to_move(goal: Goal) -> int:
    """How many objects have to move for a goal, wherever they start: not a stack's lowest nor the ends of a line."""
    kind = goal.relation.kind if goal.relation is not None else ""
    return len(goal.objects) - {"stacked": 1, "aligned": 2}.get(kind, 0)


def _check_nothing_fell_off(rollouts: Sequence[Rollout]) -> Finding:
    fallen = [
        f"object {number} fell off the table at ({x:.2f}, {y:.2f}, {z:.2f}) in seed {rollout.seed}"
        for rollout in rollouts
        for number, ((x, y, z), _) in rollout.final.items()
        if z < TABLE_TOP
    ]
    return Finding.from_fault_list("on_table", fallen, "everything ends on the table", "nothing may fall off the table")


def _check_assets_known_and_timestep_kept(instances: Sequence[TaskInstance], library: Library) -> Finding:
    """Values for what is no template would change nothing, a time step of its own would change any physics."""
    items = [item for instance in instances for item in instance.objects]
    unknown = {item.asset for item in items if item.asset not in library}
    filled = {item.asset for item in items if item.fill} - unknown - set(library.template_names())
    faults = [f"there is no asset {name}" for name in sorted(unknown)]
    faults += [f"{name} is no template" for name in sorted(filled)]
    steps = {instance.timestep for instance in instances} - {TIMESTEP}
    faults += [f"a time step of {step} s instead of {TIMESTEP} s" for step in sorted(steps)]
    bound = "every object must be the library's, and the time step the runtime's"
    return Finding.from_fault_list("as_in_library", faults, "all of them are", bound)


def _check_assets_match_task(instances: Sequence[TaskInstance], task: TaskDefinition) -> Finding:
    wanted = set(task.assets)
    faults: set[str] = set()
    for instance in instances:
        used = {item.asset for item in instance.task_objects}
        faults |= {f"{name} is not in the task definition" for name in used - wanted}
        faults |= {f"{name} is in the task definition but not used" for name in wanted - used}
    otherwise = f"the {len(wanted)} assets of the task definition, no others"
    bound = "the instances must have the assets of the task definition"
    return Finding.from_fault_list("assets_of_task", sorted(faults), otherwise, bound)


def _check_assets_are_in_photo(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> Finding:
    seen = Counter(item.asset for item in scene.objects)
    fixtures = {asset.name for asset in library.assets() if asset.fixture}
    absent = {
        f"{name} ({count} used, {seen[name]} in the photo)"
        for instance in instances
        for name, count in Counter(
            item.asset for item in instance.objects if item.asset not in fixtures or is_movable_object(item, library)
        ).items()
        if count > seen[name]
    }
    measured = f"the photo shows {len(seen)} assets"
    if absent:
        measured += f"; not there: {', '.join(sorted(absent))}"
    bound = "objects must be in the photo, or fixtures that cannot move"
    return Finding(check="assets_of_scene", passed=not absent, measured=measured, bound=bound)


def _check_revision_keeps_objects(
    task: TaskDefinition, original: TaskDefinition, scene: SceneDescription | None
) -> Finding:
    """A revision keeps at least half of the objects that the photo shows, and two where there were two."""
    shown = {item.asset for item in scene.objects} if scene is not None else set(original.assets)
    before = set(original.assets) & shown
    gone = sorted(before - set(task.assets))
    kept, least = len(before) - len(gone), max(min(2, len(before)), -(-len(before) // 2))
    measured = f"the revised task keeps {kept} of {len(before)} objects"
    if gone:
        measured += f"; gone: {', '.join(gone)}"
    return Finding(check="revision", passed=kept >= least, measured=measured, bound=f"at least {least} must stay")
