"""The task's words against its goals: trusted code tells what is asked for and what happened, the judge compares."""

from collections.abc import Sequence

from grs_agents.agents import NoReply, WordsJudgement, roles
from grs_agents.audit import Finding, pair_with_rollouts, tell_task
from grs_agents.models import is_offline
from grs_agents.nodes.services import Services
from grs_agents.nodes.task_instances import AuditedPrograms
from grs_agents.sim import Rollout, TaskInstance

BOUND = "the judge must agree"
REMEDY = f"{BOUND}; where it does not understand the words, name a model that does with audit.judge = MODEL"


def judge_words(
    audited: AuditedPrograms, instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], services: Services
) -> tuple[Finding, ...]:
    """The finding ``words``: whether the goals of every kind of instance ask for what the words say; none without a
    task. The judge is asked once for instances that differ in numbers alone.
    """
    if audited.task is None:
        return ()
    judge = services.config.model_for_role("judge").model
    kinds: set[tuple[object, ...]] = set()
    judgement: WordsJudgement | NoReply | None = None
    for instance, rollout in pair_with_rollouts(instances, [rollout for rollout in rollouts if rollout.final]):
        told = tell_task(instance, rollout, services.library, audited.scene)
        if told.kind in kinds:
            continue
        kinds.add(told.kind)
        pictures = [] if is_offline(judge) else _draw_start_and_end(instance, rollout, services)
        words = audited.task.description
        judgement = roles.judge_words(services.agents, words, told.objects, told.goals, pictures)
        if isinstance(judgement, NoReply) or judgement.verdict != "agrees":
            break
    passed, measured, bound = False, "there is no episode to judge", BOUND
    if isinstance(judgement, NoReply):
        measured, bound = str(judgement), REMEDY
    elif judgement is not None:
        measured = f"{judgement.verdict}, says the judge ({judge}): {judgement.reason}"
        passed, bound = judgement.verdict == "agrees", REMEDY if judgement.verdict == "unclear" else BOUND
    return (Finding(check="words", passed=passed, measured=measured, bound=bound),)


def _draw_start_and_end(instance: TaskInstance, rollout: Rollout, services: Services) -> list[str]:
    """Two pictures' paths in the run folder; none where pictures are switched off, or one cannot be made."""
    paths: list[str] = []
    for moment, poses in (("start", rollout.initial), ("end", rollout.final)):
        path = f"instances/seed_{instance.seed}_{moment}.png"
        drawn = services.config.end_picture and services.run_tool(
            "render",
            instance=instance.model_dump(mode="json"),
            output=str((services.folder / path).resolve()),
            poses=poses,
            **services.simulator_setup,
        )
        if not drawn or drawn.image is None:
            return []
        paths.append(path)
    return paths
