"""The effect of each fix on the score, the best version so far, and the fixes left to try.

A fix that leaves the evidence as it was, or brings back programs that were judged before, is in vain. The next fix
then takes another strategy, so that no model gets the same prompt over and over.
"""

import difflib
import hashlib
import json
from itertools import takewhile
from typing import Final, cast

from grs_agents.agents.types import TaskDefinition, Verdict
from grs_agents.audit.assertion_changes import find_changed_assertions
from grs_agents.audit.test_quality import IN_PROGRAM
from grs_agents.graph.policies.types import are_words_unclear, list_stable_failures, read_episode
from grs_agents.graph.services import Update
from grs_agents.graph.state import (
    VERDICTS,
    BestVersion,
    FixedName,
    FixRecord,
    JudgedVersion,
    ProgramName,
    RunState,
    Score,
    Strategy,
)
from grs_agents.sandbox.protocol.report import TestReport

LONGEST_STREAK: Final = 5
"""Fixes in vain in a row that end a run."""
ABOUT_TESTS: Final = "tests_"
"""Prefix of the audit's checks of the tests."""


def score_judged_programs(state: RunState) -> Score:
    """Score the programs that were judged last."""
    report = state.get("report") or TestReport(outcome="no_tests")
    audit = state.get("audit")
    findings = audit.findings if audit else ()
    if audit:
        strict = min((rollout.episode.strict for rollout in audit.rollouts), default=0.0)
    else:  # a test may stop early, or look at the start
        episodes = filter(None, (read_episode(case.episode) for case in report.cases))
        strict = max((episode.strict for episode in episodes), default=0.0)
    return Score(
        passed=sum(case.outcome == "passed" for case in report.cases),
        tests=len(report.cases),
        strict=round(strict, 3),
        held=sum(finding.passed for finding in findings),
        checks=len(findings),
        accepted=audit is not None and audit.accepted,
    )


def describe_fix_history(state: RunState) -> tuple[str, ...]:
    """A line for each fix and each assertion that it changed, then a line that names the best version."""
    words = {"-": "no longer asserted", "+": "asserted instead"}
    lines: list[str] = []
    for record in state.get("history", []):
        lines += [str(record), *(f"  {words[line[0]]}: {line[2:]}" for line in record.assertions)]
    best = state.get("best")
    return (*lines, f"best so far: {best.describe()}") if lines and best else tuple(lines)


def record_fix(
    state: RunState, fixed: FixedName, strategy: Strategy, change: Update, problem: str = "", equals: int = 0
) -> Update:
    """Add the fix to its update ``change`` of the state, and reset the audit.

    Args:
        problem: why the fix changed nothing.
        equals: the earlier version that the program equals, 0 without one.
    """
    before = state.get(fixed)
    lines = list(difflib.unified_diff(_split_lines(before), _split_lines(change.get(fixed, before)), n=0))[2:]
    version = f"{fixed}_version"
    record = FixRecord(
        fixed=fixed,
        strategy=strategy,
        version=change.get(version, state.get(version)) or 0,
        added=sum(line.startswith("+") for line in lines),
        removed=sum(line.startswith("-") for line in lines),
        equals=equals,
        problem=problem,
        assertions=find_changed_assertions(state.get("tests", ""), change["tests"]) if "tests" in change else (),
        before=score_judged_programs(state),
        evidence=_hash_evidence(state),
        programs=_hash_programs(state),
    )
    return {**change, "fixes": 1, "history": [*state.get("history", []), record], "audit": None}


def record_outcome(state: RunState, judged: Update) -> Update:
    """Add the outcome of the last fix and the best version to the update ``judged`` of the tests or the audit."""
    after = cast(RunState, {**state, **judged})
    score, history = score_judged_programs(after), state.get("history", [])
    change = dict(judged)
    if history:
        *earlier, last = history
        seen = {record.programs for record in history}
        vain = _hash_programs(after) in seen or _hash_evidence(after) == last.evidence
        change["history"] = [*earlier, last.model_copy(update={"after": score, "vain": vain})]
    best = state.get("best")
    is_final = bool(after.get("audit")) or not after["report"].all_passed
    if is_final and (not best or score.rank >= best.score.rank):
        change["best"] = BestVersion(
            score=score,
            simulation_version=state.get("simulation_version", 0),
            tests_version=state.get("tests_version", 0),
            kept=JudgedVersion(
                task=after["task"],
                revised=after.get("revised"),
                simulation=after["simulation"],
                tests=after.get("tests", ""),
                report=after.get("report"),
                audit=after.get("audit"),
            ),
        )
    return change


def list_untried_fix_strategies(state: RunState) -> dict[Verdict, Strategy]:
    """The strategy of the next fix by verdict: a fix in vain since the last progress is not tried again.

    Empty once ``LONGEST_STREAK`` fixes in a row were in vain, and where the words alone are at fault and stay.
    """
    history, audit, decision = state.get("history", []), state.get("audit"), state.get("decision")
    failures = audit.failures if audit else ()
    suspects: tuple[ProgramName, ...] = ("simulation", "tests")
    if failures and all(are_words_unclear(finding) for finding in failures):
        suspects = ()
    elif failures and all(
        finding.check.startswith(ABOUT_TESTS) and IN_PROGRAM not in finding.measured for finding in failures
    ):
        suspects = ("tests",)
    elif audit or (history and not decision) or (decision and decision.policy == "always_code"):
        suspects = ("simulation",)  # the audit failed otherwise, or no router decides
    streak = list_latest_fixes_in_vain(state)
    if len(streak) >= LONGEST_STREAK:
        return {}
    # of the programs written anew for the present task: their authors would get the same prompts again
    of_this_task = takewhile(lambda record: record.fixed != "task" or record.vain, reversed(history))
    rewrites = [record for record in of_this_task if record.strategy == "rewrite"]
    tried = {(record.fixed, record.strategy) for record in (*streak, *rewrites)}
    moves: dict[Verdict, Strategy] = {}
    for suspect in suspects:
        untried: list[Strategy] = [strategy for strategy in ("fix", "rewrite") if (suspect, strategy) not in tried]
        if untried:
            moves[VERDICTS[suspect]] = untried[0]
    if state.get("revisable"):
        moves["fix_task"] = "fix"
    return moves or {VERDICTS[suspect]: "fix" for suspect in suspects}


def list_latest_fixes_in_vain(state: RunState) -> list[FixRecord]:
    """The fixes in vain since the last progress, latest first."""
    return list(takewhile(lambda record: record.vain, reversed(state.get("history", []))))


def _split_lines(value: str | TaskDefinition | None) -> list[str]:
    text = json.dumps(value.as_json(), indent=1) if isinstance(value, TaskDefinition) else value or ""
    return text.splitlines()


def _hash_programs(state: RunState) -> str:
    task = state.get("task")
    return _hash_json([task and task.as_json(), state.get("simulation"), state.get("tests")])


def _hash_evidence(state: RunState) -> str:
    """Hash of report and audit without the parts that vary between runs."""
    report, audit = state.get("report"), state.get("audit")
    failed = [(finding.check, finding.detail) for finding in audit.failures] if audit else []
    return _hash_json([list_stable_failures(report) if report else (), failed])


def _hash_json(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
