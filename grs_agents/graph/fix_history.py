"""What each fix changed and did to the score, which version was best, and what is left to try.

A fix that leaves the evidence as it was, or brings back programs that were judged before, is in vain. After such a fix
the next one goes another way, so that no model is asked the same thing over and over.
"""

import difflib
import hashlib
import json
from collections.abc import Sequence
from itertools import takewhile
from typing import Any, Final, Literal, cast

from grs_agents.agents.types import Verdict
from grs_agents.audit.assertion_changes import find_changed_assertions
from grs_agents.audit.types import AuditReport
from grs_agents.base import Frozen
from grs_agents.graph.policies.types import list_stable_failures, read_episode
from grs_agents.graph.services import Update
from grs_agents.graph.state import RunState
from grs_agents.sandbox.protocol.report import TestReport

ProgramName = Literal["simulation", "tests"]
FixedName = Literal["simulation", "tests", "task"]
Strategy = Literal["fix", "rewrite"]
"""Mend what is there, or have it written anew by its author."""
STRATEGIES: Final[tuple[Strategy, ...]] = ("fix", "rewrite")
VERDICTS: Final[dict[FixedName, Verdict]] = {"simulation": "fix_code", "tests": "fix_test", "task": "fix_task"}
LONGEST_STREAK = 5
"""So many fixes in vain, one after the other, end a run."""
ABOUT_TESTS = "tests_"
"""How the audit's checks of the tests begin."""
KEPT = ("task", "revised", "simulation", "tests", "report", "audit")
"""The fields of the state that the best version comes back with."""


class Score(Frozen):
    """How good a pair of programs is; of two, the better is the one with the greater ``rank``."""

    passed: int = 0  # tests
    tests: int = 0
    strict: float = 0.0  # of the oracle: the lowest over the audit's seeds, or else the highest in the tests
    held: int = 0  # checks of the audit
    checks: int = 0  # 0 where the audit did not run
    accepted: bool = False

    @property
    def rank(self) -> tuple[bool, float, float, float]:
        """The audit's verdict, then what the robot reached, then the checks and tests that hold."""
        return self.accepted, self.strict, self.held / max(1, self.checks), self.passed / max(1, self.tests)

    def __str__(self) -> str:
        audit = f", audit {self.held}/{self.checks} checks" if self.checks else ""
        return f"tests {self.passed}/{self.tests}, strict {self.strict:.2f}{audit}"


class FixRecord(Frozen):
    """One fix: what was done, and the score before and after it."""

    fixed: FixedName
    strategy: Strategy
    version: int  # of that program after the fix
    equals: int = 0  # the earlier version of that program that it equals; 0: none
    added: int  # lines
    removed: int
    problem: str = ""  # why the model gave nothing that could be used
    before: Score
    after: Score | None = None  # None until the programs were judged again
    evidence: str  # hash of the evidence that the fix was asked for with
    programs: str  # hash of task and programs before the fix
    assertions: tuple[str, ...] = ()  # of the tests: what was taken out (``- ...``) or put in its place (``+ ...``)
    vain: bool = False  # the evidence stayed as it was, or the programs were judged before

    @property
    def has_changed_lines(self) -> bool:
        """Whether anything was changed."""
        return bool(self.added or self.removed)

    def __str__(self) -> str:
        name = VERDICTS[self.fixed]
        what = "written anew" if self.strategy == "rewrite" else f"version {self.version}"
        what += f", equal to version {self.equals}" if self.equals else ""
        change = f"{what} (+{self.added} -{self.removed} lines)" if self.has_changed_lines else "unchanged"
        outcome = f"{self.before} -> {self.after or 'not judged'}"
        return f"{name}: {self.problem or change}: {outcome}{'; in vain' if self.vain else ''}"


class BestVersion(Frozen):
    """The best pair of programs so far, with all that was found out about it."""

    score: Score
    simulation_version: int
    tests_version: int
    kept: dict[str, Any]  # `KEPT`

    def describe(self) -> str:
        """Its versions and score, in words."""
        return f"program version {self.simulation_version} with tests version {self.tests_version} ({self.score})"


def score_judged_programs(state: RunState) -> Score:
    """The score of the programs that were judged last."""
    report = TestReport.model_validate(state["report"]) if state.get("report") else TestReport(outcome="no_tests")
    audit = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    findings = audit.findings if audit is not None else ()
    if audit is not None:
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


def read_fix_history(state: RunState) -> list[FixRecord]:
    """The fixes made so far, oldest first."""
    return [FixRecord.model_validate(record) for record in state.get("history", [])]


def describe_fix_history(state: RunState) -> tuple[str, ...]:
    """One line for each fix, and one that names the best version."""
    lines = [line for record in read_fix_history(state) for line in (str(record), *_assertion_lines(record))]
    if lines and state.get("best"):
        best = BestVersion.model_validate(state["best"])
        lines.append(f"best so far: {best.describe()}")
    return tuple(lines)


def _assertion_lines(record: FixRecord) -> list[str]:
    told = {"-": "no longer asserted", "+": "asserted instead"}
    return [f"  {told[line[0]]}: {line[2:]}" for line in record.assertions]


def record_fix(
    state: RunState, fixed: FixedName, strategy: Strategy, change: Update, problem: str = "", equals: int = 0
) -> Update:
    """What a fix changes in the state, with the fix in the history; ``problem`` is why it changed nothing, ``equals``
    the earlier version that the program equals."""
    old, new = (
        _split_into_json_or_text_lines(state.get(fixed, "")),
        _split_into_json_or_text_lines(change.get(fixed, state.get(fixed, ""))),
    )
    lines = list(difflib.unified_diff(old, new, n=0))[2:]  # after its two headers
    version = f"{fixed}_version"
    record = FixRecord(
        fixed=fixed,
        strategy=strategy,
        version=change.get(version, state.get(version)) or 0,
        added=sum(line.startswith("+") for line in lines),
        removed=sum(line.startswith("-") for line in lines),
        equals=equals,
        problem=problem,
        assertions=find_changed_assertions(str(state.get("tests", "")), str(change["tests"]))
        if "tests" in change
        else (),
        before=score_judged_programs(state),
        evidence=_hash_evidence(state),
        programs=_hash_programs(state),
    )
    history = [*state.get("history", []), record.model_dump(mode="json")]
    return {**change, "fixes": 1, "history": history, "audit": {}}


def record_outcome(state: RunState, judged: Update) -> Update:
    """``judged``, the result of the tests or of the audit, with what it says of the last fix and the best version."""
    after = cast(RunState, {**state, **judged})
    score, history = score_judged_programs(after), read_fix_history(state)
    change = dict(judged)
    if history:
        last = history[-1]
        seen = {record.programs for record in history}
        vain = _hash_programs(after) in seen or _hash_evidence(after) == last.evidence
        history[-1] = last.model_copy(update={"after": score, "vain": vain})
        change["history"] = [record.model_dump(mode="json") for record in history]
    best = BestVersion.model_validate(state["best"]) if state.get("best") else None
    is_final = bool(after.get("audit")) or not TestReport.model_validate(after["report"]).all_passed
    if is_final and (best is None or score.rank >= best.score.rank):
        versions = {f"{name}_version": state.get(f"{name}_version", 0) for name in ("simulation", "tests")}
        kept = {name: after.get(name, {}) for name in KEPT}
        change["best"] = BestVersion(score=score, kept=kept, **versions).model_dump(mode="json")
    return change


def list_untried_fix_strategies(state: RunState) -> dict[Verdict, Strategy]:
    """What the next fix may be, by verdict: what was in vain since the last progress is not tried again.

    Empty once ``LONGEST_STREAK`` fixes in a row were in vain.
    """
    history, suspects = read_fix_history(state), _list_suspected_programs(state)
    streak = list(takewhile(lambda record: record.vain, reversed(history)))
    if len(streak) >= LONGEST_STREAK:
        return {}
    tried = {(record.fixed, record.strategy) for record in (*streak, *_list_rewrites_for_this_task(history))}
    moves: dict[Verdict, Strategy] = {}
    for suspect in suspects:
        strategy: Strategy | None = next((one for one in STRATEGIES if (suspect, one) not in tried), None)
        if strategy is not None:
            moves[VERDICTS[suspect]] = strategy
    if state.get("revisable"):
        moves["fix_task"] = "fix"
    return moves or {VERDICTS[suspect]: "fix" for suspect in suspects}


def _list_rewrites_for_this_task(history: Sequence[FixRecord]) -> list[FixRecord]:
    """The programs written anew for the present task: their author would be asked just the same again."""
    of_this_task = takewhile(lambda record: record.fixed != "task" or record.vain, reversed(history))
    return [record for record in of_this_task if record.strategy == "rewrite"]


def _list_suspected_programs(state: RunState) -> tuple[ProgramName, ...]:
    """The tests are none where it was the audit that found fault, nor where nobody asks whose fault it is; they alone
    are where all that the audit found is about them."""
    failed = [finding["check"] for finding in (state.get("audit") or {}).get("findings", ()) if not finding["passed"]]
    if failed and all(check.startswith(ABOUT_TESTS) for check in failed):
        return ("tests",)
    decision = state.get("decision", {})
    unasked = bool(state.get("history")) and not decision
    code_only = state.get("audit") or unasked or decision.get("policy") == "always_code"
    return ("simulation",) if code_only else ("simulation", "tests")


def _split_into_json_or_text_lines(value: object) -> list[str]:
    return (value if isinstance(value, str) else json.dumps(value, indent=1)).splitlines()


def _hash_programs(state: RunState) -> str:
    return _hash_json([state.get(name) for name in ("task", "simulation", "tests")])


def _hash_evidence(state: RunState) -> str:
    """Of what the report and the audit say, without what differs from run to run."""
    report = list_stable_failures(TestReport.model_validate(state["report"])) if state.get("report") else ()
    audit = AuditReport.model_validate(state["audit"]) if state.get("audit") else None
    failed = [(finding.check, finding.detail) for finding in audit.findings if not finding.passed] if audit else []
    return _hash_json([report, failed])


def _hash_json(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
