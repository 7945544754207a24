"""The judging nodes: run the tests, route, audit; and the edges that read their verdicts."""

from collections.abc import Sequence
from typing import Any, Literal, cast

from grs_agents.agents.types import TaskDefinition, Verdict
from grs_agents.audit.static_checks import check_programs
from grs_agents.audit.types import AuditReport, StaticFinding
from grs_agents.base.files import write_json, write_text
from grs_agents.base.trace.events import Decision, Finding, Note, TestsRun
from grs_agents.graph.auditing import audit_programs
from grs_agents.graph.authoring import PROGRAM_FILES, task_from_state, write_task_file
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.earlier_judgements import (
    forget_judgements,
    keep_audit,
    keep_test_report,
    recall_audit,
    recall_test_report,
)
from grs_agents.graph.fix_history import (
    LONGEST_STREAK,
    BestVersion,
    list_untried_fix_strategies,
    read_fix_history,
    record_outcome,
)
from grs_agents.graph.fixing import collect_evidence_for_fixer
from grs_agents.graph.policies.types import EarlierDecision, RoutingContext, RoutingDecision, list_stable_failures
from grs_agents.graph.rejection import explain_rejection
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import AuditedPrograms, play_first_seed
from grs_agents.perception.types import SceneDescription
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.rollouts import Rollout

_RAN = ("passed", "failed", "error", "no_assertion", "skipped", "expected_failure")
"""Outcomes of tests that ran to their end."""


@logged_node("run_tests")
def run_tests(state: RunState, services: Services) -> Update:
    """Run the static checks, then the tests in the sandbox; an earlier report of the same programs is used again."""
    found = check_programs(state["simulation"], state["tests"], task_from_state(state), services.library)
    report = recall_test_report(state, services)
    if report is None:
        result = services.run_tool(
            "run_tests",
            simulation=state["simulation"],
            tests=state["tests"],
            seed=services.config.seed,
            **program_tool_settings(SceneDescription.model_validate(state["scene"]), services),
        )
        report = TestReport.model_validate(result.report)
        keep_test_report(state, report, services)
    services.log.append(TestsRun(report=report.model_dump(mode="json")))
    static = [finding.model_dump(mode="json") for finding in found]
    return record_outcome(state, {"report": report.model_dump(mode="json"), "static": static, "audit": {}})


@logged_node("route")
def decide_what_to_fix(state: RunState, services: Services) -> Update:
    """Decide what to fix, among what is left to try."""
    report = TestReport.model_validate(state["report"])
    judged = collect_evidence_for_fixer(state, services, "route")
    verdicts = tuple(list_untried_fix_strategies(state))
    context = RoutingContext(
        task=judged.task,
        report=report,
        results=judged.results,
        audit_failed=bool(state.get("audit")),
        history=tuple(judged.history),
        agents=services.agents,
        simulation=judged.code,
        tests=judged.tests,
        scene=judged.scene,
        static=tuple(StaticFinding.model_validate(finding) for finding in state.get("static", [])),
        images=tuple(judged.images),
        verdicts=verdicts,
        earlier=tuple(EarlierDecision.model_validate(decision_json) for decision_json in state.get("routed", [])),
    )
    decision = services.policy.decide(context)
    if decision.verdict not in verdicts:
        why = f"{decision.verdict} is not left to try, so {verdicts[0]} is next; {decision.explanation}"
        decision = decision.model_copy(update={"verdict": verdicts[0], "explanation": why})
    services.log.append(Decision(verdict=decision.verdict, explanation=decision.explanation, policy=decision.policy))
    routed = EarlierDecision(failures=list_stable_failures(report), verdict=decision.verdict)
    return {"decision": decision.model_dump(mode="json"), "routed": [routed.model_dump(mode="json")]}


@logged_node("audit")
def audit_task(state: RunState, services: Services) -> Update:
    """Instantiate the program for each seed and let the trusted oracle solve the instances, once for each pair of
    programs."""
    audited = AuditedPrograms(
        simulation=state["simulation"],
        tests=state.get("tests") or None,
        report=TestReport.model_validate(state["report"]) if state.get("report") else None,
        task=TaskDefinition.model_validate(state["task"]),
        original=TaskDefinition.model_validate(state["revised"]["from"]) if state.get("revised") else None,
        scene=SceneDescription.model_validate(state["scene"]),
    )
    report = recall_audit(state, services)
    if report is None:
        report = audit_programs(audited, services)
        keep_audit(state, report, services)
    record_audit(report, services)
    return record_outcome(state, {"audit": report.model_dump(mode="json")})


@logged_node("conclude")
def conclude_with_best_version(state: RunState, services: Services) -> Update:
    """Set status and reason. Restores the best version of a rejected run and records its film."""
    forget_judgements(services)
    ended, kept, left = state, dict[str, Any](), ""
    best = BestVersion.model_validate(state["best"]) if state.get("best") else None
    accepted = bool(state.get("audit")) and AuditReport.model_validate(state["audit"]).accepted
    better = best is not None and any(
        best.kept[name] != state.get(name, {}) for name in ("task", "simulation", "tests")
    )
    if best is not None and better and (state.get("problem") or not accepted):
        services.log.append(Note(text=f"{best.describe()} is put back in place: it was the best"))
        restore_best_version(best, services)
        kept, left = best.kept, f"; left in place is {best.describe()}, the best of {len(state.get('history', [])) + 1}"
        ended = cast(RunState, {**state, **kept})
    status, reason = decide_run_status_and_reason(ended, _play_unplayed_program(ended, services))
    return {**kept, "status": status, "reason": reason + left}


def _play_unplayed_program(state: RunState, services: Services) -> tuple[Rollout, ...]:
    """The rollout of a rejected program that was not audited, or whose recordings another program's have replaced; none
    of a program that does not run, or not within its limits."""
    report = TestReport.model_validate(state["report"]) if state.get("report") else None
    audit = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    cases = report.cases if report is not None and report.outcome in ("passed", "failed") else ()
    ran = bool(cases) and all(case.outcome in _RAN for case in cases)
    recorded = audit is not None and any((services.folder / "instances").glob("seed_*.npz"))
    if not ran or recorded or (audit is not None and audit.accepted):
        return ()
    return play_first_seed(state["simulation"], services, SceneDescription.model_validate(state["scene"]))


def restore_best_version(best: BestVersion, services: Services) -> None:
    """Write the files of the best version over those of the last one."""
    for program, file in PROGRAM_FILES.items():
        write_text(services.folder / file, best.kept[program])
    write_task_file(best.kept["task"], best.kept["revised"], services)
    if best.kept["audit"]:
        write_json(services.folder / "audit.json", best.kept["audit"])
    else:
        (services.folder / "audit.json").unlink(missing_ok=True)
    for stale in (services.folder / "instances").glob("seed_*"):  # of another program
        stale.unlink()


def record_audit(report: AuditReport, services: Services) -> None:
    """Write ``audit.json`` and one event for each finding."""
    write_json(services.folder / "audit.json", report.model_dump(mode="json"))
    for finding in report.findings:
        services.log.append(Finding(**finding.model_dump()))


def decide_run_status_and_reason(
    state: RunState, rollouts: Sequence[Rollout] = ()
) -> tuple[Literal["accepted", "rejected"], str]:
    """The status of a finished run and its reason; ``rollouts`` are of programs that were not audited."""
    if state.get("problem"):
        return "rejected", state["problem"]
    report = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    if report is not None and report.accepted:
        reason = f"the tests pass and all {len(report.findings)} checks of the audit hold"
        given_up = state.get("revised", {}).get("given-up", "")
        return "accepted", reason + (f"; the task was revised: {given_up}" if given_up else "")
    fixes = f"{state.get('fixes', 0)} of {state['max_fixes']} fixes used"
    if not list_untried_fix_strategies(state):
        fixes += f", the last {LONGEST_STREAK} in vain"
    tests = TestReport.model_validate(state["report"]) if state.get("report") else None
    scene = SceneDescription.model_validate(state["scene"]) if state.get("scene") else None
    reason = explain_rejection(tests, report, rollouts if report is None else (), scene)
    if report is not None:
        failed = [finding.check for finding in report.findings if not finding.passed]
        return "rejected", f"{reason} (audit failed: {', '.join(failed)}; {fixes})"
    failed = [case.id.rpartition(".")[2] for case in tests.cases if case.outcome != "passed"] if tests else []
    names = f": {', '.join(failed)}" if failed else ""
    return "rejected", f"{reason} (tests {tests.outcome if tests else 'did not run'}{names}; {fixes})"


def next_step_after_author(state: RunState) -> Literal["ok", "stop"]:
    """After an author: go on unless its model gave no usable reply."""
    return "stop" if state.get("problem") else "ok"


def next_step_after_tests(state: RunState) -> Literal["audit", "fix", "stop"]:
    """After the tests: audit what passed, fix what failed while there are fixes left and things to try."""
    return "audit" if TestReport.model_validate(state["report"]).all_passed else _choose_fix_or_stop(state)


def next_step_after_audit(state: RunState) -> Literal["fix", "stop"]:
    """After the audit: stop when it accepts, fix while there are fixes left and things to try."""
    return "stop" if AuditReport.model_validate(state["audit"]).accepted else _choose_fix_or_stop(state)


def _choose_fix_or_stop(state: RunState) -> Literal["fix", "stop"]:
    return "fix" if state.get("fixes", 0) < state["max_fixes"] and list_untried_fix_strategies(state) else "stop"


def read_routing_verdict(state: RunState) -> Verdict:
    """After the router: what it decided."""
    return RoutingDecision.model_validate(state["decision"]).verdict


def next_step_after_fix_task(state: RunState) -> Literal["write", "judge"]:
    """After the task author: have programs written for another task; a task that stayed as it was is routed again."""
    return "write" if read_fix_history(state)[-1].has_changed_lines else "judge"
