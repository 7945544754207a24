"""The judging nodes: run the tests, route, audit, conclude; and the conditions of the edges that leave them."""

from collections.abc import Sequence
from typing import Any, Literal, cast

from grs_agents.agents.types import Verdict
from grs_agents.audit.static_checks import check_programs
from grs_agents.base.files import write_json, write_text
from grs_agents.base.trace.events import Decision, Finding, Note, TestsRun
from grs_agents.graph.auditing import audit_programs
from grs_agents.graph.authoring import PROGRAM_FILES, write_task_file
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
    list_latest_fixes_in_vain,
    list_untried_fix_strategies,
    record_outcome,
)
from grs_agents.graph.fixing import collect_evidence_for_fixer
from grs_agents.graph.policies.types import EarlierDecision, RoutingContext, list_stable_failures
from grs_agents.graph.rejection import explain_rejection
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState, parse_state
from grs_agents.graph.task_instances import AuditedPrograms, play_first_seed
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.rollouts import Rollout

_RAN = ("passed", "failed", "error", "no_assertion", "skipped", "expected_failure")
"""Outcomes of tests that ran to their end."""


@logged_node("run_tests")
def run_tests(state: RunState, services: Services) -> Update:
    """Run the static checks, then the tests in the sandbox; an earlier report of the same programs is used again."""
    static = list(check_programs(state["simulation"], state["tests"], state["task"], services.library))
    report = recall_test_report(state, services)
    if report is None:
        report = TestReport.model_validate(
            services.run_tool(
                "run_tests",
                simulation=state["simulation"],
                tests=state["tests"],
                seed=services.config.seed,
                **program_tool_settings(state["scene"], services),
            ).report
        )
        keep_test_report(state, report, services)
    services.log.append(TestsRun(report=dict(report)))
    return record_outcome(state, {"report": report, "static": static, "audit": None})


@logged_node("route")
def decide_what_to_fix(state: RunState, services: Services) -> Update:
    """Let the policy choose the next fix among the untried."""
    judged = collect_evidence_for_fixer(state, services, "route")
    verdicts, audit = tuple(list_untried_fix_strategies(state)), state.get("audit")
    context = RoutingContext(
        task=judged.task,
        report=state["report"],
        results=judged.results,
        audit_failed=bool(audit),
        history=tuple(judged.history),
        agents=services.agents,
        simulation=judged.code,
        tests=judged.tests,
        scene=judged.scene,
        static=tuple(state.get("static", [])),
        images=tuple(judged.images),
        verdicts=verdicts,
        earlier=tuple(state.get("routed", [])),
        audit=audit,
    )
    decision = services.policy.decide(context)
    if decision.verdict not in verdicts:
        why = f"{decision.verdict} is not left to try, so {verdicts[0]} is next; {decision.explanation}"
        decision = decision.model_copy(update={"verdict": verdicts[0], "explanation": why})
    services.log.append(Decision(verdict=decision.verdict, explanation=decision.explanation, policy=decision.policy))
    routed = EarlierDecision(failures=list_stable_failures(state["report"]), verdict=decision.verdict)
    return {"decision": decision, "routed": [routed]}


@logged_node("audit")
def audit_task(state: RunState, services: Services) -> Update:
    """Audit the program on task instances that the trusted oracle solves, once for each pair of programs."""
    report = recall_audit(state, services)
    if report is None:
        revised = state.get("revised")
        audited = AuditedPrograms(
            simulation=state["simulation"],
            tests=state.get("tests") or None,
            report=state.get("report"),
            task=state["task"],
            original=revised.original if revised else None,
            scene=state["scene"],
        )
        report = audit_programs(audited, services)
        keep_audit(state, report, services)
    write_json(services.folder / "audit.json", report)
    if report.sentence:
        write_task_file(state["task"], state.get("revised"), services, report)
    for finding in report.findings:
        services.log.append(Finding(**dict(finding)))
    return record_outcome(state, {"audit": report})


@logged_node("conclude")
def conclude_with_best_version(state: RunState, services: Services) -> Update:
    """Set status and reason. Restores the best version of a rejected run and records its film."""
    forget_judgements(services)
    ended, kept, left = state, dict[str, Any](), ""
    audit, best = state.get("audit"), state.get("best")
    if best and (state.get("problem") or not audit or not audit.accepted):
        now = (state.get("task"), state.get("simulation"), state.get("tests", ""))
        if (best.kept.task, best.kept.simulation, best.kept.tests) != now:
            services.log.append(Note(text=f"{best.describe()} is put back in place: it was the best"))
            write_text(services.folder / PROGRAM_FILES["simulation"], best.kept.simulation)
            write_text(services.folder / PROGRAM_FILES["tests"], best.kept.tests)
            write_task_file(best.kept.task, best.kept.revised, services, best.kept.audit)
            (services.folder / "audit.json").unlink(missing_ok=True)
            if best.kept.audit is not None:
                write_json(services.folder / "audit.json", best.kept.audit)
            for stale in (services.folder / "instances").glob("seed_*"):  # of another program
                stale.unlink()
            kept = best.kept.as_update()
            left = f"; left in place is {best.describe()}, the best of {len(state.get('history', [])) + 1}"
            ended = cast(RunState, {**state, **kept})
    report, audit = ended.get("report"), ended.get("audit")
    cases = report.cases if report and report.outcome in ("passed", "failed") else ()
    ran = bool(cases) and all(case.outcome in _RAN for case in cases)
    recorded = audit and any((services.folder / "instances").glob("seed_*.npz"))
    rollouts: tuple[Rollout, ...] = ()
    if ran and not recorded and not (audit and audit.accepted):  # not audited, or filmed with another program
        rollouts = play_first_seed(ended["simulation"], services, ended["scene"])
    status, reason = _decide_run_status_and_reason(ended, rollouts)
    return {**kept, "status": status, "reason": reason + left}


def _decide_run_status_and_reason(
    state: RunState, rollouts: Sequence[Rollout]
) -> tuple[Literal["accepted", "rejected"], str]:
    """The status of a finished run and its reason; ``rollouts`` are of programs that were not audited."""
    if state.get("problem"):
        return "rejected", state["problem"]
    audit, tests, revised = state.get("audit"), state.get("report"), state.get("revised")
    if audit and audit.accepted:
        reason = f"the tests pass and all {len(audit.findings)} checks of the audit hold"
        if audit.words is not None and audit.words.verdict == "not_judged":
            reason += ", for the sentence of its goals: the author's words are not judged"
        return "accepted", reason + (f"; the task was revised: {revised.given_up}" if revised else "")
    fixes = f"{state.get('fixes', 0)} of {state['max_fixes']} fixes used"
    if len(list_latest_fixes_in_vain(state)) >= LONGEST_STREAK:
        fixes += f", the last {LONGEST_STREAK} in vain"
    reason = explain_rejection(tests, audit, () if audit else rollouts, state.get("scene"))
    if audit:
        failed = [finding.check for finding in audit.findings if not finding.passed]
        return "rejected", f"{reason} (audit failed: {', '.join(failed)}; {fixes})"
    failed = [case.id.rpartition(".")[2] for case in tests.cases if case.outcome != "passed"] if tests else []
    names = f": {', '.join(failed)}" if failed else ""
    return "rejected", f"{reason} (tests {tests.outcome if tests else 'did not run'}{names}; {fixes})"


def next_step_after_tests(state: RunState) -> Literal["audit", "fix", "stop"]:
    """After the tests: audit if they pass, else fix while there are fixes left and strategies to try."""
    state = parse_state(state)
    return "audit" if state["report"].all_passed else _choose_fix_or_stop(state)


def next_step_after_audit(state: RunState) -> Literal["fix", "stop"]:
    """After the audit: stop when it accepts, fix while there are fixes left and strategies to try."""
    state = parse_state(state)
    audit = state["audit"]
    return "stop" if audit and audit.accepted else _choose_fix_or_stop(state)


def _choose_fix_or_stop(state: RunState) -> Literal["fix", "stop"]:
    return "fix" if state.get("fixes", 0) < state["max_fixes"] and list_untried_fix_strategies(state) else "stop"


def read_routing_verdict(state: RunState) -> Verdict:
    """After the router: its verdict."""
    state = parse_state(state)
    return state["decision"].verdict


def next_step_after_fix_task(state: RunState) -> Literal["write", "judge"]:
    """After the task author: have programs written for another task; a task that stayed as it was is routed again."""
    state = parse_state(state)
    return "write" if state["history"][-1].has_changed_lines else "judge"
