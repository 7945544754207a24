"""The judging nodes: run the tests, route, audit; and the edges that read their verdicts."""

from typing import Literal

from grs_agents.agents import TaskDefinition
from grs_agents.audit import AuditReport
from grs_agents.audit import audit_task as judge
from grs_agents.files import write_json
from grs_agents.nodes.authoring import format_test_and_audit
from grs_agents.nodes.services import Services, Update, logged_node
from grs_agents.nodes.task_instances import solve_task_instances
from grs_agents.perception import SceneDescription
from grs_agents.policies import Routed, RoutingContext, failures_without_run_details
from grs_agents.sandbox import TestReport
from grs_agents.state import RunState
from grs_agents.trace import Decision, Finding, TestsRun


@logged_node("run_tests")
def run_tests(state: RunState, services: Services) -> Update:
    """Run the tests against the program, in the sandbox."""
    result = services.run_tool(
        "run_tests",
        simulation=state["simulation"],
        tests=state["tests"],
        library_roots=[str(root) for root in services.library.roots],
        robot=services.robot_name_or_path,
        background=SceneDescription.model_validate(state["scene"]).background,
        seed=services.config.seed,
    )
    report: TestReport = result.report
    services.log.append(TestsRun(report=report.model_dump(mode="json")))
    return {"report": report.model_dump(mode="json"), "audit": {}}


@logged_node("route")
def decide_what_to_fix(state: RunState, services: Services) -> Update:
    """Decide whether to fix the program or the tests."""
    report = TestReport.model_validate(state["report"])
    context = RoutingContext(
        task=TaskDefinition.model_validate(state["task"]),
        report=report,
        results=format_test_and_audit(state),
        audit_failed=bool(state.get("audit")),
        history=tuple(state.get("history", [])),
        agents=services.agents,
        earlier=tuple(Routed.model_validate(decision_json) for decision_json in state.get("routed", [])),
    )
    decision = services.policy.decide(context)
    services.log.append(Decision(verdict=decision.verdict, explanation=decision.explanation, policy=decision.policy))
    routed = Routed(failures=failures_without_run_details(report), verdict=decision.verdict)
    return {
        "decision": decision.model_dump(mode="json"),
        "history": [f"route: {decision.verdict}"],
        "routed": [routed.model_dump(mode="json")],
    }


@logged_node("audit")
def audit_task(state: RunState, services: Services) -> Update:
    """Instantiate the program for each seed and let the trusted oracle solve the instances."""
    scene = SceneDescription.model_validate(state["scene"])
    measured = solve_task_instances(state["simulation"], services, scene.background)
    report = judge(
        measured.instances,
        measured.failures,
        measured.rollouts,
        services.config.audit,
        services.library,
        TaskDefinition.model_validate(state["task"]),
        scene,
    )
    record_audit(report, services)
    return {"audit": report.model_dump(mode="json")}


@logged_node("conclude")
def conclude_run(state: RunState, services: Services) -> Update:
    """Say how the run ended, and why."""
    status, reason = decide_verdict(state)
    return {"status": status, "reason": reason}


def record_audit(report: AuditReport, services: Services) -> None:
    """Write ``audit.json`` and one event for each finding."""
    write_json(services.folder / "audit.json", report.model_dump(mode="json"))
    for finding in report.findings:
        services.log.append(Finding(check=finding.check, passed=finding.passed, detail=finding.detail))


def decide_verdict(state: RunState) -> tuple[Literal["accepted", "rejected"], str]:
    """The status of a finished run and its reason."""
    if state.get("problem"):
        return "rejected", state["problem"]
    report = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    if report is not None and report.accepted:
        return "accepted", f"the tests pass and all {len(report.findings)} checks of the audit hold"
    fixes = f"{state.get('fixes', 0)} of {state['max_fixes']} fixes used"
    if report is not None:
        failed = "; ".join(f"{item.check}: {item.detail}" for item in report.findings if not item.passed)
        return "rejected", f"audit failed ({fixes}): {failed}"
    tests = TestReport.model_validate(state["report"])
    failing = [f"{case.id}: {case.message or case.outcome}" for case in tests.cases if case.outcome != "passed"]
    return "rejected", f"tests {tests.outcome} ({fixes}): {'; '.join([*filter(None, [tests.message]), *failing])}"


def next_step_after_author(state: RunState) -> Literal["ok", "stop"]:
    """After an author: go on unless its model gave no usable reply."""
    return "stop" if state.get("problem") else "ok"


def next_step_after_tests(state: RunState) -> Literal["audit", "fix", "stop"]:
    """After the tests: audit what passed, fix what failed while fixes remain."""
    if TestReport.model_validate(state["report"]).all_passed:
        return "audit"
    return "fix" if state.get("fixes", 0) < state["max_fixes"] else "stop"


def next_step_after_audit(state: RunState) -> Literal["fix", "stop"]:
    """After the audit: stop when it accepts, fix while fixes remain."""
    if AuditReport.model_validate(state["audit"]).accepted:
        return "stop"
    return "fix" if state.get("fixes", 0) < state["max_fixes"] else "stop"


def next_step_after_route(state: RunState) -> Literal["fix_code", "fix_tests"]:
    """After the router: the node that does what it decided."""
    return "fix_code" if state["decision"]["verdict"] == "fix_code" else "fix_tests"
