"""The audit of two programs: trusted code measures them, then every check judges what was measured."""

import hashlib
from collections.abc import Iterator, Sequence

from grs_agents.agents import roles
from grs_agents.agents.types import NoReply, WordsJudgement
from grs_agents.audit.checks import audit_task, check_report_of_unforeseen_seeds
from grs_agents.audit.goal_checks import pair_instances_with_rollouts
from grs_agents.audit.goal_sentences import describe_task_in_words
from grs_agents.audit.seed_and_override_checks import check_program
from grs_agents.audit.side_words import explain_ambiguous_sides
from grs_agents.audit.types import AuditReport, Finding
from grs_agents.base.config.schema import AuditConfig, Config
from grs_agents.base.trace.events import Note
from grs_agents.graph.services import Services
from grs_agents.graph.task_instances import AuditedPrograms, SolvedInstances, solve_task_instances
from grs_agents.graph.test_probing import probe_tests
from grs_agents.models.factory import is_offline
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout

_WORDS_BOUND = "the judge must agree"
_WORDS_REMEDY = (
    f"{_WORDS_BOUND}; where it does not understand the words, name a model that does with audit.judge = MODEL"
)
_SIDES_BOUND = "sides are the robot's, and words must say so where a photo shows others: 'left, as the robot sees it'"
_UNFORESEEN = 8
"""Seeds beside those of the configuration that are drawn: what a twelfth of the seeds shows is found every second time,
what a third shows 24 times of 25, for 3 ms each or more."""
_LEFT_OUT = "What the photo shows and the task does not use was left out (scene.bystanders = false)."


def audit_programs(audited: AuditedPrograms, services: Services) -> AuditReport:
    """Instantiate the program for each seed, let the trusted oracle solve the instances, and judge.

    More seeds follow from the text of both programs, so that neither can name them, and that an audit which is
    repeated, or a run that is resumed, comes out the same.

    The tests are probed only where all before holds, since their mutants are made from what the oracle solved; and
    the words are judged last, since that may cost a model's reply.
    """
    measured, report = audit_instances(audited, services, _derive_unforeseen_seeds(audited, services.config))
    if report.accepted:
        report = _append_findings_to_report(report, probe_tests(audited, measured, services))
    report = _append_findings_to_report(report, [check_program(audited.simulation)])
    if report.accepted:
        seen = [measured] if measured.unforeseen is None else [measured, measured.unforeseen]
        instances = [instance for one in seen for instance in one.instances]
        rollouts = [rollout for one in seen for rollout in one.rollouts]
        report = _append_findings_to_report(report, _judge_words_against_goals(audited, instances, rollouts, services))
    return _note_left_out_bystanders(report, audited, services)


def audit_instances(
    audited: AuditedPrograms, services: Services, unforeseen_seeds: Sequence[int] = ()
) -> tuple[SolvedInstances, AuditReport]:
    """What trusted code measures of a program's task instances, and what the checks say of that alone."""
    measured = solve_task_instances(audited.simulation, services, audited.scene, unforeseen_seeds)
    report = _audit_measured_instances(measured, services.config.audit, audited, services)
    if measured.unforeseen is None:
        return measured, report
    seeds = tuple(one.seed for one in measured.unforeseen.instances) or tuple(unforeseen_seeds[:1])
    some = services.config.audit.model_copy(update={"seeds": len(seeds)})
    other = _audit_measured_instances(measured.unforeseen, some, audited, services)
    report = report.model_copy(update={"unforeseen_seeds": seeds})
    finding = check_report_of_unforeseen_seeds(seeds, len(unforeseen_seeds), other)
    return measured, _append_findings_to_report(report, [finding])


def _derive_unforeseen_seeds(audited: AuditedPrograms, config: Config) -> list[int]:
    """Seeds that a program cannot name, since each change of a program changes them; none of the other seeds."""
    known = {config.seed + step for step in range(config.audit.seeds)}
    text, seeds = f"{audited.simulation}\0{audited.tests}", list[int]()
    while len(seeds) < _UNFORESEEN:
        seed = int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])
        if seed not in known:
            known.add(seed)
            seeds.append(seed)
        text += "\0"
    return seeds


def _audit_measured_instances(
    measured: SolvedInstances, config: AuditConfig, audited: AuditedPrograms, services: Services
) -> AuditReport:
    return audit_task(
        measured.instances,
        measured.failures,
        measured.rollouts,
        config,
        services.library,
        audited.task,
        audited.scene,
        audited.original,
    )


def _append_findings_to_report(report: AuditReport, further: Sequence[Finding]) -> AuditReport:
    """A report with what other checks found."""
    accepted = report.accepted and all(finding.passed for finding in further)
    return report.model_copy(update={"findings": (*report.findings, *further), "accepted": accepted})


def _note_left_out_bystanders(report: AuditReport, audited: AuditedPrograms, services: Services) -> AuditReport:
    """The report, with a word where the configuration leaves out what else the photo shows."""
    if audited.scene is None or services.config.scene.bystanders:
        return report
    services.log.append(Note(text=_LEFT_OUT))
    return report.model_copy(update={"about": f"{report.about} {_LEFT_OUT}"})


def _judge_words_against_goals(
    audited: AuditedPrograms, instances: Sequence[TaskInstance], rollouts: Sequence[Rollout], services: Services
) -> tuple[Finding, ...]:
    """The finding ``words``: whether the goals of every kind of instance ask for what the words say; none without a
    task. The judge is asked once for instances that differ in lengths and turns alone.
    """
    if audited.task is None:
        return ()
    frame = audited.scene.frame if audited.scene is not None else None
    if ambiguous := explain_ambiguous_sides(audited.task.description, frame):
        return (Finding(check="words", passed=False, measured=f"unclear: {ambiguous}", bound=_SIDES_BOUND),)
    judge = services.config.model_for_role("judge").model
    kinds: set[tuple[object, ...]] = set()
    judgement: WordsJudgement | NoReply | None = None
    for instance, rollout in _pair_distinct_instances_with_rollouts(instances, rollouts):
        told = describe_task_in_words(instance, rollout, services.library, audited.scene)
        if told.kind in kinds:
            continue
        kinds.add(told.kind)
        pictures = [] if is_offline(judge) else _draw_start_and_end(instance, rollout, services)
        words, other_texts = audited.task.description, (f"name: {audited.task.name}", *told.other_texts)
        judgement = roles.judge_words(services.agents, words, other_texts, told.objects, told.goals, pictures)
        if isinstance(judgement, NoReply) or judgement.verdict != "agrees":
            break
    passed, measured, bound = False, "there is no episode to judge", _WORDS_BOUND
    if isinstance(judgement, NoReply):
        measured, bound = str(judgement), _WORDS_REMEDY
    elif judgement is not None:
        measured = f"{judgement.verdict}, says the judge ({judge}): {judgement.reason}"
        passed, bound = judgement.verdict == "agrees", _WORDS_REMEDY if judgement.verdict == "unclear" else _WORDS_BOUND
    return (Finding(check="words", passed=passed, measured=measured, bound=bound),)


def _pair_distinct_instances_with_rollouts(
    instances: Sequence[TaskInstance], rollouts: Sequence[Rollout]
) -> Iterator[tuple[TaskInstance, Rollout]]:
    """Each instance with its film, where there is one; of those that differ in their seeds alone the first."""
    seen: list[TaskInstance] = []
    for instance, rollout in pair_instances_with_rollouts(
        instances, [rollout for rollout in rollouts if rollout.final]
    ):
        unseeded = instance.model_copy(update={"seed": 0})
        if unseeded not in seen:
            seen.append(unseeded)
            yield instance, rollout


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
            textured=True,
            **services.library_root_fields,
        )
        if not drawn or drawn.image is None:
            return []
        paths.append(path)
    return paths
