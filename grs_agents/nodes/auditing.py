"""The audit of two programs: trusted code measures them, then every check judges what was measured."""

from collections.abc import Sequence

from grs_agents.audit import AuditReport, Finding, audit_task
from grs_agents.nodes.services import Services
from grs_agents.nodes.task_instances import AuditedPrograms, solve_task_instances
from grs_agents.nodes.test_probing import probe_tests
from grs_agents.nodes.word_judging import judge_words
from grs_agents.trace import Note

_LEFT_OUT = "What the photo shows and the task does not use was left out (scene.bystanders = false)."


def audit_programs(audited: AuditedPrograms, services: Services) -> AuditReport:
    """Instantiate the program for each seed, let the trusted oracle solve the instances, and judge.

    The tests are probed only where all before holds, since their mutants are made from what the oracle solved; and
    the words are judged last, since that may cost a model's reply.
    """
    measured = solve_task_instances(audited.simulation, services, audited.scene)
    report = audit_task(
        measured.instances,
        measured.failures,
        measured.rollouts,
        services.config.audit,
        services.library,
        audited.task,
        audited.scene,
        audited.original,
    )
    if report.accepted:
        report = _add_findings(report, probe_tests(audited, measured, services))
    if report.accepted:
        report = _add_findings(report, judge_words(audited, measured.instances, measured.rollouts, services))
    return _say_what_is_left_out(report, audited, services)


def _add_findings(report: AuditReport, further: Sequence[Finding]) -> AuditReport:
    """An accepted report with what other checks found."""
    accepted = all(finding.passed for finding in further)
    return report.model_copy(update={"findings": (*report.findings, *further), "accepted": accepted})


def _say_what_is_left_out(report: AuditReport, audited: AuditedPrograms, services: Services) -> AuditReport:
    """The report, with a word where the configuration leaves out what else the photo shows."""
    if audited.scene is None or services.config.scene.bystanders:
        return report
    services.log.append(Note(text=_LEFT_OUT))
    return report.model_copy(update={"about": f"{report.about} {_LEFT_OUT}"})
