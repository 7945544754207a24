"""What routers, fixers and policies read of a run: static findings, tests, the robot's episodes and the audit.

The text is made of lines under headings ``== ...``. An episode that several tests or seeds share is shown once.
"""

import re
from collections.abc import Iterator, Sequence

from grs_agents.audit.types import AuditReport, StaticFinding
from grs_agents.base import Vec3
from grs_agents.graph.policies.types import read_episode
from grs_agents.graph.state import RunState
from grs_agents.sandbox.protocol.report import OUTCOME_MEANINGS, TestCase, TestReport
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE
from grs_agents.sim.instance.episode import Episode, GoalOutcome, ObjectMotion

EPISODES, ROWS, CLAUSES = 3, 24, 6
"""The most distinct episodes, tests or rows of one table, and shortfalls of one goal that are shown."""
_LINE = 1000
"""Longer lines are cut, characters."""
_TILTED = 5
"""Degrees from which on a tilt is told."""
_FRAME = re.compile(r'^\s*File "(?P<file>[^"]*)", line (?P<line>\d+), in (?P<function>.*)$')


def evidence_from_state(state: RunState) -> str:
    """The evidence of the latest tests and of the audit that followed them."""
    report = TestReport.model_validate(state["report"]) if state.get("report") else None
    audit = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    findings = [StaticFinding.model_validate(finding) for finding in state.get("static", [])]
    return render_evidence(report, audit, findings)


def render_evidence(
    report: TestReport | None, audit: AuditReport | None = None, findings: Sequence[StaticFinding] = ()
) -> str:
    """All that was found out about a pair of programs; each distinct episode once."""
    sections = [
        _static_findings_section(findings),
        _tests_section(report),
        *_episode_sections(report),
        *_audit_sections(audit),
    ]
    return "\n\n".join("\n".join(line[:_LINE] for line in lines) for lines in sections if lines) or "(nothing was run)"


def _static_findings_section(findings: Sequence[StaticFinding]) -> list[str]:
    lines = [f"{finding.program} line {finding.line}: {finding.kind}: {finding.message}" for finding in findings]
    return ["== static checks", *lines] if lines else []


def _tests_section(report: TestReport | None) -> list[str]:
    if report is None:
        return []
    passed = sum(case.outcome == "passed" for case in report.cases)
    head = f"{report.outcome}: {passed} of {len(report.cases)} tests passed"
    lines = ["== tests", head + (f"; {report.message}" if report.message else "")]
    if not report.cases and report.raised_in:
        lines.append(f"raised in: {report.raised_in}")
    lines += _relevant_traceback(report.traceback)
    shown: dict[str, str] = {}  # the first test that each traceback is of
    cases = sorted(report.cases, key=lambda case: case.outcome == "passed")
    for case in cases[:ROWS]:
        lines += _test_lines(case, shown)
    if len(cases) > ROWS:
        lines.append(f"and {len(cases) - ROWS} more tests")
    outcomes = dict.fromkeys([report.outcome, *(case.outcome for case in report.cases)])
    return [*lines, *(f"({name}: {OUTCOME_MEANINGS[name]})" for name in outcomes if name in OUTCOME_MEANINGS)]


def _test_lines(case: TestCase, shown: dict[str, str]) -> Iterator[str]:
    """One test; a traceback that an earlier test of ``shown`` has is not repeated."""
    yield _outcome_line(case)
    if case.outcome == "passed":
        return
    if case.traceback and not _is_failed_assertion(case):
        first = shown.setdefault(case.traceback.partition("\n")[2][-300:], case.id)
        yield from _relevant_traceback(case.traceback) if first == case.id else [f"  as in {first}"]
    if case.output.strip():
        yield "  printed: " + " | ".join(case.output.strip().splitlines()[-5:])[-300:]


def _is_failed_assertion(case: TestCase) -> bool:
    """A failed assertion is no error that was raised in the tests: it is worded differently."""
    return case.outcome == "failed" and case.raised_in == "tests"


def _outcome_line(case: TestCase) -> str:
    message = f": {case.message}" if case.message else ""
    if not _is_failed_assertion(case):
        return f"{case.id}: {case.outcome}" + (f" (raised in {case.raised_in})" if case.raised_in else "") + message
    frames = [match for match in map(_FRAME.match, case.traceback.splitlines()) if match]
    line = next((f", line {frame['line']}" for frame in reversed(frames) if frame["file"] == TESTS_FILE), "")
    return f"{case.id}: failed: assertion failed in {case.id}{line}{message.removeprefix(': AssertionError')}"


def _relevant_traceback(traceback: str) -> list[str]:
    """The last lines of a traceback: of its frames those in the two programs, and what was raised."""
    kept: list[str] = []
    ours = True
    for line in traceback.splitlines():
        if frame := _FRAME.match(line):
            ours = frame["file"] in (SIMULATION_FILE, TESTS_FILE)
        elif not line.startswith("  "):
            ours = True
        if ours and line.strip(" ^~") and not line.startswith("Traceback "):
            kept.append(f"  {line}")
    return kept[-12:]


def _episode_sections(report: TestReport | None) -> Iterator[list[str]]:
    """The distinct episodes of the tests, those of failed tests first."""
    named: dict[Episode, list[str]] = {}
    for case in sorted(report.cases if report else (), key=lambda case: case.outcome == "passed"):
        if (episode := read_episode(case.episode)) is not None:
            hook = f"{case.episode_hook} of " if case.episode_hook not in ("", "test") else ""
            named.setdefault(episode, []).append(f"{hook}{case.id}")
    for episode, names in list(named.items())[:EPISODES]:
        yield [f"== oracle episode ({', '.join(names)})", *_episode_lines(episode)]


def _episode_lines(episode: Episode) -> Iterator[str]:
    yield f"outcome: {episode.outcome}"
    steps = f"{episode.steps}/{episode.max_steps}"
    yield f"published: {episode.reward:.2f}  strict: {episode.strict:.2f}  steps: {steps}"
    yield f"detail: {episode.detail}"
    if episode.objects:
        yield f"concerns: {', '.join(episode.objects)}"
    actions = [
        f"{number}. {action.asset} #{action.object} {_point(action.pick)} -> {_point(action.place)}: {action.note}"
        for number, action in enumerate(episode.actions, 1)
    ]
    yield from _list_rows_up_to_limit("goals", [_format_goal_outcome(goal) for goal in episode.goals])
    yield from _list_rows_up_to_limit("actions", actions)
    yield from _list_rows_up_to_limit(
        "objects", [_format_object_motion(motion) for motion in sorted(episode.motions, key=lambda m: not m.moved)]
    )
    yield from _list_rows_up_to_limit("warnings", episode.warnings)


def _list_rows_up_to_limit(title: str, rows: Sequence[str]) -> Iterator[str]:
    if rows:
        yield f"{title}:"
        yield from (f"  {row}" for row in rows[:ROWS])
    if len(rows) > ROWS:
        yield f"  and {len(rows) - ROWS} more"


def _format_goal_outcome(goal: GoalOutcome) -> str:
    row = f"worth {goal.worth:.2f}, published {goal.published:.2f}, strict {goal.strict:.2f}: {goal.goal}"
    return f"{row}; misses: {'; '.join(goal.shortfalls[:CLAUSES])}" if goal.shortfalls else row


def _format_object_motion(motion: ObjectMotion) -> str:
    end = f" -> {_point(motion.end)}" if motion.moved else ", not moved"
    tilt = f", tilted {motion.tilt:.0f} degrees" if motion.tilt >= _TILTED else ""
    return f"{motion.asset} #{motion.object} {_point(motion.start)}{end}{tilt}"


def _point(position: Vec3) -> str:
    return f"({', '.join(f'{value:.3f}' for value in position)})"


def _audit_sections(audit: AuditReport | None) -> Iterator[list[str]]:
    """The findings, one line for each seed, and the episode of the seed that fell shortest."""
    if audit is None:
        return
    held = [finding.check for finding in audit.findings if finding.passed]
    head = f"{'accepted' if audit.accepted else 'failed'}: {len(held)} of {len(audit.findings)} checks hold"
    failed = [f"- {finding.check}: FAILED: {finding.detail}" for finding in audit.findings if not finding.passed]
    seeds = [
        f"seed {rollout.seed}: {rollout.episode.outcome}, published {rollout.episode.reward:.2f}, "
        f"strict {rollout.episode.strict:.2f}, steps {rollout.episode.steps}/{rollout.episode.max_steps}"
        for rollout in audit.rollouts
    ]
    yield ["== audit", f"{head}: {', '.join(held)}" if held else head, *failed, *seeds]
    if audit.rollouts:
        shortest = min(audit.rollouts, key=lambda rollout: rollout.episode.strict)
        yield [f"== oracle episode (audit seed {shortest.seed})", *_episode_lines(shortest.episode)]
