"""The checks: pure functions from instances and rollouts to findings."""

from collections.abc import Sequence

from grs_agents.agents import TaskDefinition
from grs_agents.audit.types import AuditReport, Change, Finding
from grs_agents.config import AuditConfig
from grs_agents.library import Library
from grs_agents.scene import SceneDescription
from grs_agents.sim import InstanceObject, Rollout, TaskInstance
from grs_agents.sim.rollout import IDLE_SECONDS

SAME_PLACE = 0.03
"""An object within this many metres (in the table plane) of its place in the photo has kept it."""


def audit(
    instances: Sequence[TaskInstance],
    failures: Sequence[str],
    rollouts: Sequence[Rollout],
    config: AuditConfig,
    library: Library,
    task: TaskDefinition | None = None,
    scene: SceneDescription | None = None,
) -> AuditReport:
    """Judge a task from what trusted code measured.

    Args:
        instances: the validated task instances, one for each seed that gave one.
        failures: one line for each seed that gave none, or whose rollout failed.
        rollouts: the trusted oracle's runs of the instances.
        config: the bounds.
        library: tells fixtures from things that must be in the photo.
        task: the definition the program must keep to; ``None`` for a program without one.
        scene: the photo the program must keep to; ``None`` for a program without one.
    """
    findings = [
        _instantiated(instances, failures, config),
        _solved(rollouts, config),
        _not_idle(rollouts, config),
        _moved(rollouts, scene),
    ]
    if task is not None:
        findings.append(_assets_of_task(instances, task))
    if scene is not None:
        findings.append(_assets_of_scene(instances, scene, library))
    return AuditReport(
        accepted=all(finding.passed for finding in findings),
        findings=tuple(findings),
        changes=tuple(changes(instances, scene)) if scene is not None else (),
        rollouts=tuple(rollouts),
        rewards=tuple(rollout.episode.reward for rollout in rollouts),
    )


def library_name(thing: InstanceObject) -> str:
    """The library's name of an instance's object; a filled template is named ``template#values``."""
    return thing.asset.partition("#")[0]


def changes(instances: Sequence[TaskInstance], scene: SceneDescription) -> list[Change]:
    """Every object position that was not taken from the photo."""
    found: list[Change] = []
    for instance in instances:
        for thing in instance.objects:
            x, y, _ = thing.pose[0]
            places = [place.position for place in scene.objects if place.asset == library_name(thing)]
            distances = [((x - place[0]) ** 2 + (y - place[1]) ** 2) ** 0.5 for place in places]
            nearest = min(range(len(places)), key=distances.__getitem__) if places else None
            if nearest is not None and distances[nearest] <= SAME_PLACE:
                continue
            found.append(
                Change(
                    seed=instance.seed,
                    asset=thing.asset,
                    position=thing.pose[0],
                    photo=None if nearest is None else places[nearest],
                    distance=None if nearest is None else distances[nearest],
                )
            )
    return found


def _instantiated(instances: Sequence[TaskInstance], failures: Sequence[str], config: AuditConfig) -> Finding:
    detail = f"{len(instances)} of {config.seeds} seeds gave a task instance"
    if failures:
        detail += "; " + "; ".join(failures)
    return Finding(check="instantiated", passed=len(instances) == config.seeds and not failures, detail=detail)


def _solved(rollouts: Sequence[Rollout], config: AuditConfig) -> Finding:
    rewards = [rollout.episode.reward for rollout in rollouts]
    shown = ", ".join(f"{reward:.2f}" for reward in rewards) or "none"
    passed = len(rewards) == config.seeds and all(reward >= config.reward for reward in rewards)
    detail = f"rewards {shown}; each of {config.seeds} must reach {config.reward}"
    return Finding(check="solved", passed=passed, detail=detail)


def _not_idle(rollouts: Sequence[Rollout], config: AuditConfig) -> Finding:
    rewards = [rollout.idle_reward for rollout in rollouts]
    shown = ", ".join(f"{reward:.2f}" for reward in rewards) or "none"
    detail = f"doing nothing for {IDLE_SECONDS} s earns {shown}; must stay below {config.reward}"
    return Finding(check="not_idle", passed=bool(rewards) and max(rewards) < config.reward, detail=detail)


def _moved(rollouts: Sequence[Rollout], scene: SceneDescription | None) -> Finding:
    counts = [len(rollout.moved) for rollout in rollouts]
    if scene is not None:
        reachable = sum(thing.reachable for thing in scene.objects)
    else:
        reachable = min((len(rollout.reachable) for rollout in rollouts), default=0)
    needed = max(1, min(2, reachable))
    detail = f"objects moved: {counts}; at least {needed} must, {reachable} are in reach"
    return Finding(check="moved", passed=bool(counts) and min(counts) >= needed, detail=detail)


def _assets_of_task(instances: Sequence[TaskInstance], task: TaskDefinition) -> Finding:
    used = {library_name(thing) for instance in instances for thing in instance.objects}
    foreign, unused = sorted(used - set(task.assets)), sorted(set(task.assets) - used)
    detail = f"{len(used)} assets used"
    if foreign:
        detail += f"; not in the task definition: {', '.join(foreign)}"
    if unused:
        detail += f"; named by the task definition but not used: {', '.join(unused)}"
    return Finding(check="assets_of_task", passed=not foreign and not unused, detail=detail)


def _assets_of_scene(instances: Sequence[TaskInstance], scene: SceneDescription, library: Library) -> Finding:
    seen = {thing.asset for thing in scene.objects}
    fixtures = {asset.name for asset in library.assets() if asset.fixture}
    foreign: list[str] = []
    for instance in instances:
        counts: dict[str, int] = {}
        for thing in instance.objects:
            counts[library_name(thing)] = counts.get(library_name(thing), 0) + 1
        for name, count in counts.items():
            limit = sum(place.asset == name for place in scene.objects)
            if name not in fixtures and count > limit:
                foreign.append(f"{name} ({count} used, {limit} in the photo)")
        for thing in instance.objects:  # shapes of its own would let anything pass under an asset's name
            if thing.shapes is not None and library_name(thing) not in library.templates():
                foreign.append(f"{thing.asset} (with shapes that are not the library's)")
    detail = f"the photo shows {len(seen)} assets"
    if foreign:
        detail += f"; not there: {', '.join(sorted(set(foreign)))}"
    return Finding(check="assets_of_scene", passed=not foreign, detail=detail)
