"""The checks: pure functions from instances and rollouts to findings."""

import re
from collections import Counter
from collections.abc import Sequence

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.goal_checks import MAY_STAY, is_movable_object, list_goal_findings
from grs_agents.audit.pose_changes import find_pose_changes, is_object_covered_in_photo
from grs_agents.audit.scene_checks import check_visibility, list_scene_findings
from grs_agents.audit.types import AuditFinding, AuditReport
from grs_agents.base.config.schema import AuditConfig
from grs_agents.library.library import Library
from grs_agents.perception.types import SEEN_TOO_SPARSELY, SceneDescription
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.spec import TIMESTEP

_VARYING = frozenset({"random", "randomly", "shuffled", "varying"})
"""Words of a task that say that its seeds differ. A fixed place is anywhere as well."""
GOAL = 0.95
"""Least strict score of each single goal, so that a goal of little reward cannot be missed."""
_ABOUT_SEVERAL = frozenset({"sure_hand", "seeds_differ"})
"""Checks of all instances together, which do not apply to a single instance."""
TABLE_TOP = -0.02
"""Height of the object's origin (m) below which it has fallen off the table."""


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
    """Judge a task by its instances and episodes, which trusted code measured.

    Args:
        instances: validated task instance of each seed that gave the same instance twice.
        failures: a line for each seed without an instance, or with a failed rollout.
        rollouts: the trusted oracle's runs of the instances.
        config: the bounds.
        library: tells fixtures from objects that must be in the photo.
        task: the definition that the program must keep to; ``None`` for a program without a definition.
        scene: the photo that the program must keep to; ``None`` for a program without a photo.
        original: the definition before the task was revised; ``None`` for an unrevised task.
    """
    findings = [
        check_all_seeds_instantiate(instances, failures, config),
        check_oracle_solves_instances(rollouts, config),
        check_seeds_differ(instances, task),
        check_objects_moved(instances, rollouts, scene),
        check_nothing_fell_off(rollouts),
        check_assets_known_and_timestep_kept(instances, library),
        *list_goal_findings(instances, rollouts, library, scene, config.reward),
        *list_scene_findings(instances, rollouts, library, scene),
        check_visibility(instances, rollouts, library, scene),
    ]
    if task is not None:
        findings.append(check_assets_match_task(instances, task))
    if task is not None and original is not None:
        findings.append(check_revision_keeps_objects(task, original, scene))
    if scene is not None:
        findings.append(check_assets_are_in_photo(instances, scene, library))
    seeds = ", ".join(str(instance.seed) for instance in instances) or "none"
    return AuditReport(
        accepted=all(finding.passed for finding in findings),
        findings=tuple(findings),
        changes=tuple(find_pose_changes(instances, scene, library)) if scene is not None else (),
        rollouts=tuple(rollouts),
        rewards=tuple(rollout.episode.reward for rollout in rollouts),
        about=f"The verdict is about the task instances, of the seeds {seeds}; two processes drew each of them alike. "
        "It is not about the program, which may draw anything for other seeds.",
    )


def check_report_of_unforeseen_seeds(seeds: Sequence[int], drawn: int, report: AuditReport) -> AuditFinding:
    """The finding ``unforeseen``: ``report`` is about the instances of ``seeds``, a part of the ``drawn`` unforeseen
    seeds."""
    failed = [finding for finding in report.findings if not finding.passed and finding.check not in _ABOUT_SEVERAL]
    audited = f"seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))}"
    return AuditFinding(
        check="unforeseen",
        passed=not failed,
        measured=f"{audited} of {drawn} that follow from the text of the programs: "
        + ("all checks hold" if not failed else "; ".join(f"{finding.check}: {finding.detail}" for finding in failed)),
        bound="what is asked of the other instances is asked of one more, whose seed the program cannot know, and of "
        "those that show another kind of scene",
    )


def check_all_seeds_instantiate(
    instances: Sequence[TaskInstance], failures: Sequence[str], config: AuditConfig
) -> AuditFinding:
    """The finding ``instantiated``: every seed gave an instance."""
    return AuditFinding(
        check="instantiated",
        passed=len(instances) == config.seeds and not failures,
        measured="; ".join([f"{len(instances)} of {config.seeds} seeds gave a task instance", *failures]),
        bound="each must",
    )


def check_oracle_solves_instances(rollouts: Sequence[Rollout], config: AuditConfig) -> AuditFinding:
    """The finding ``solved``: strict and published scores, outcome, and the weakest goal of each episode."""
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
    solved = (
        all(
            min(episode.strict, episode.reward) >= config.reward and episode.outcome == "success"
            for episode in episodes
        )
        and weakest >= GOAL
    )
    return AuditFinding(
        check="solved",
        passed=len(episodes) == config.seeds and solved,
        measured=measured,
        bound=f"each of {config.seeds} must reach {config.reward}, and every goal {GOAL}",
    )


def check_seeds_differ(instances: Sequence[TaskInstance], task: TaskDefinition | None) -> AuditFinding:
    """The finding ``seeds_differ``: equal instances are a fault only if the task says that something varies."""
    different = len({serialize_instance_without_seed(instance) for instance in instances})
    words = re.findall(r"[a-z]+", task.description.lower()) if task is not None else []
    varying = sorted(_VARYING & set(words))
    return AuditFinding(
        check="seeds_differ",
        passed=different > 1 or len(instances) < 2 or not varying,
        measured=f"{len(instances)} seeds give {different} different task instances",
        bound=f"the task says that something varies ({', '.join(varying)}), so they must differ"
        if varying
        else "the task does not say that they must",
    )


def serialize_instance_without_seed(instance: TaskInstance) -> str:
    """All of an instance but its seed, as text, to compare instances."""
    return instance.model_dump_json(exclude={"seed"})


def check_objects_moved(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], scene: SceneDescription | None
) -> AuditFinding:
    """The finding ``moved``: a task from a photo moves two of its objects, if two can be moved; others, if their goals
    ask for two."""
    if scene is not None:
        seen = {item.asset for item in scene.objects}
        counts = [sum(name in seen for name in rollout.moved) for rollout in rollouts]
        movable = sum(
            item.reachable and not (item.held or item.pick_trouble or is_object_covered_in_photo(item, scene))
            for item in scene.objects
        )
        why = f"{movable} are in reach, uncovered and not held, and the robot can pick them"
    else:
        counts = [len(rollout.moved) for rollout in rollouts]
        to_move = [
            sum(len(goal.objects) - MAY_STAY.get(goal.relation_kind or "", 0) for goal in instance.goals)
            for instance in instances
        ]
        movable = min(to_move, default=0)
        why = f"the goals ask for {movable}"
    needed = max(1, min(2, movable))
    return AuditFinding(
        check="moved",
        passed=bool(counts) and min(counts) >= needed,
        measured=f"objects moved by the robot: {counts}",
        bound=f"at least {needed} must be, {why}",
    )


def check_nothing_fell_off(rollouts: Sequence[Rollout]) -> AuditFinding:
    """The finding ``on_table``."""
    fallen = [
        f"object {number} fell off the table at ({x:.2f}, {y:.2f}, {z:.2f}) in seed {rollout.seed}"
        for rollout in rollouts
        for number, ((x, y, z), _) in rollout.final.items()
        if z < TABLE_TOP
    ]
    bound = "nothing may fall off the table"
    return AuditFinding.from_fault_list("on_table", fallen, "everything ends on the table", bound)


def check_assets_known_and_timestep_kept(instances: Sequence[TaskInstance], library: Library) -> AuditFinding:
    """The finding ``as_in_library``: values for a mesh asset would have no effect, another time step would change the
    physics."""
    items = [item for instance in instances for item in instance.objects]
    unknown = {item.asset for item in items if item.asset not in library}
    filled = {item.asset for item in items if item.fill} - unknown - set(library.template_names())
    faults = [f"there is no asset {name}" for name in sorted(unknown)]
    faults += [f"{name} is no template" for name in sorted(filled)]
    steps = {instance.timestep for instance in instances} - {TIMESTEP}
    faults += [f"a time step of {step} s instead of {TIMESTEP} s" for step in sorted(steps)]
    bound = "every object must be the library's, and the time step the runtime's"
    return AuditFinding.from_fault_list("as_in_library", faults, "all of them are", bound)


def check_assets_match_task(instances: Sequence[TaskInstance], task: TaskDefinition) -> AuditFinding:
    """The finding ``assets_of_task``."""
    wanted = set(task.assets)
    faults: set[str] = set()
    for instance in instances:
        used = {item.asset for item in instance.task_objects}
        faults |= {f"{name} is not in the task definition" for name in used - wanted}
        faults |= {f"{name} is in the task definition but not used" for name in wanted - used}
    otherwise = f"the {len(wanted)} assets of the task definition, no others"
    bound = "the instances must have the assets of the task definition"
    return AuditFinding.from_fault_list("assets_of_task", sorted(faults), otherwise, bound)


def check_assets_are_in_photo(
    instances: Sequence[TaskInstance], scene: SceneDescription, library: Library
) -> AuditFinding:
    """The finding ``assets_of_scene``: the photo shows each asset, fixtures apart, as often as an instance uses it, and
    each clearly enough."""
    seen = Counter(item.asset for item in scene.objects)
    sure = Counter(item.asset for item in scene.objects if not item.is_doubtful)
    fixtures = {asset.name for asset in library.assets() if asset.fixture}
    absent = {
        f"{name} ({count} used, {seen[name]} in the photo)"
        for instance in instances
        for name, count in Counter(
            item.asset for item in instance.objects if item.asset not in fixtures or is_movable_object(item, library)
        ).items()
        if count > seen[name]
    }
    doubtful = {
        name
        for instance in instances
        for name, count in Counter(item.asset for item in instance.task_objects).items()
        if sure[name] < min(count, seen[name])
    }
    measured = f"the photo shows {len(seen)} assets"
    if absent:
        measured += f"; not there: {', '.join(sorted(absent))}"
    if doubtful:
        measured += f"; {SEEN_TOO_SPARSELY} for a task: {', '.join(sorted(doubtful))}"
    bound = "objects must be in the photo, or fixtures that cannot move"
    return AuditFinding(check="assets_of_scene", passed=not absent and not doubtful, measured=measured, bound=bound)


def check_revision_keeps_objects(
    task: TaskDefinition, original: TaskDefinition, scene: SceneDescription | None
) -> AuditFinding:
    """The finding ``revision``: at least half of the objects that the photo shows, and two of two or more, are kept."""
    shown = {item.asset for item in scene.objects} if scene is not None else set(original.assets)
    before = set(original.assets) & shown
    removed = sorted(before - set(task.assets))
    kept, least = len(before) - len(removed), max(min(2, len(before)), -(-len(before) // 2))
    measured = f"the revised task keeps {kept} of {len(before)} objects"
    if removed:
        measured += f"; gone: {', '.join(removed)}"
    return AuditFinding(check="revision", passed=kept >= least, measured=measured, bound=f"at least {least} must stay")
