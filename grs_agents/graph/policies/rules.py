"""The policy ``rules``: decides from typed findings, without a model, whether the program or its tests are at fault."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property

from grs_agents.agents.types import Verdict
from grs_agents.graph.policies.task_word_checks import read_task_words
from grs_agents.graph.policies.types import Cause, RoutingContext, RoutingDecision, list_stable_failures, read_episode
from grs_agents.sandbox.protocol.report import TestCase
from grs_agents.sim.instance.episode import Episode

_BROKEN_SOURCE = (
    *("syntax", "import", "unknown_name", "unknown_asset", "wrong_arguments", "endless_loop"),
    *("class_missing", "base_call_missing"),
)
_OTHER_TASK = ("asset_not_in_task", "asset_unused", "object_without_goal")
"""Static findings of a program that is not that of the task, however well it runs."""
_SHOWS_NOTHING = ("no_assertion", "skipped", "expected_failure", "missing", "extra", "duplicate", "replaced")
_MEDDLING = re.compile(r"\.(?:max_steps|goals|pos_eps|rot_eps) = .*|\.(?:add_object|add_goal)\(.*")
"""Changes that tests make to the task or the scene that they test."""
_STRICTLY_MET = 0.95
"""Least strict score of an episode whose goals are met."""
_SAME_PLACE = 0.02
"""Greatest distance (m) of the start of an object from its place in the photo."""
_INFEASIBLE = ("target_too_small", "unreachable", "no_free_space", "no_seal", "would_tip")
"""Outcomes that no program may be able to change: the task has to be revised."""


class Rules:
    """Decide from types: static findings, who raised an error, how the oracle fared, what the task's words ask for.

    The program is at fault if its source or its run is broken, if the oracle falls short, if goals are met only
    loosely, or if it succeeds at another task. Otherwise the tests are: they are in error, or expect more than the task
    says. A verdict that left the report as it was gives way to the opposite verdict.
    """

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Apply the first rule that matches; compare with the report of the decision before."""
        evidence = _Evidence(context)
        rules: tuple[Callable[[_Evidence], RoutingDecision | None], ...] = (
            _decide_by_load_failures,  # the rules that leave no doubt come first
            _decide_by_failed_cases,
            _decide_by_oracle_episodes,
            _decide_by_task_words,
            _decide_against_tests,
        )
        decision = next(filter(None, (rule(evidence) for rule in rules)))
        last = context.earlier[-1] if context.earlier and not context.audit_failed else None
        if last is None or last.failures != list_stable_failures(context.report):
            return decision
        opposite: Verdict = "fix_test" if last.verdict == "fix_code" else "fix_code"
        if last.verdict == decision.verdict == "fix_code" and evidence.is_infeasible and "fix_task" in context.verdicts:
            opposite = "fix_task"
        why = f"{last.verdict} left the report as it was, so {opposite} is next; {decision.explanation}"
        return RoutingDecision(verdict=opposite, explanation=why, policy="rules")


class _Evidence:
    """The context, and the facts that several rules read from it."""

    def __init__(self, context: RoutingContext) -> None:
        self.context, self.report = context, context.report
        self.failed = [case for case in self.report.cases if case.outcome not in ("passed", "not_run")]

    def find_static_finding(self, program: str, kinds: tuple[str, ...]) -> str:
        """The first static finding of these kinds that blames ``program``, in words; empty if there is none."""
        for finding in self.context.static:
            if finding.program == program and finding.kind in kinds:
                return f"line {finding.line} of the {program} program: {finding.message}"
        return ""

    @cached_property
    def episodes(self) -> list[tuple[TestCase, Episode]]:
        """The oracle's episodes with their tests, failed tests first."""
        cases = sorted(self.report.cases, key=lambda case: case.outcome == "passed")
        read = [(case, read_episode(case.episode)) for case in cases]
        return [(case, episode) for case, episode in read if episode is not None]

    @cached_property
    def solved(self) -> Episode | None:
        """An episode in which the oracle met every goal, if there is any."""
        return next((episode for _, episode in self.episodes if episode.outcome == "success"), None)

    @property
    def is_infeasible(self) -> bool:
        """Whether no episode succeeds, and an object does not fit or cannot be reached or held."""
        return self.solved is None and any(episode.outcome in _INFEASIBLE for _, episode in self.episodes)


def _blame_program(why: str, sure: bool = True) -> RoutingDecision:
    return RoutingDecision(verdict="fix_code", explanation=why, policy="rules", cause="wrong_program", sure=sure)


def _blame_tests(why: str, sure: bool = True, expectation: bool = False) -> RoutingDecision:
    cause: Cause = "wrong_expectation" if expectation else "tests_error"
    return RoutingDecision(verdict="fix_test", explanation=why, policy="rules", cause=cause, sure=sure)


def _decide_by_load_failures(evidence: _Evidence) -> RoutingDecision | None:
    """A failed audit, broken sources, and tests that did not run."""
    report = evidence.report
    if evidence.context.audit_failed and "fix_code" not in evidence.context.verdicts:
        return _blame_tests("the audit finds fault with the tests alone")
    if evidence.context.audit_failed:
        return _blame_program("the tests pass but the audit of the task instances fails")
    if fault := evidence.find_static_finding("simulation", _BROKEN_SOURCE):
        return _blame_program(fault)
    if fault := evidence.find_static_finding("tests", (*_BROKEN_SOURCE, "no_tests")):
        return _blame_tests(fault)
    if report.cases:
        return None
    why = f"no test ran: {report.message} (raised in {report.raised_in or report.outcome})"
    in_tests = report.raised_in == "tests" or report.outcome in ("no_tests", "load_tests")
    return _blame_tests(why) if in_tests else _blame_program(why)


def _decide_by_failed_cases(evidence: _Evidence) -> RoutingDecision | None:
    """Tests that change the task that they test, and errors and limits in the program."""
    if evidence.failed and (meddling := _MEDDLING.search(evidence.context.tests)):
        return _blame_tests(f"the tests change what they test: {meddling[0][:80]}", sure=False)
    for case in evidence.failed:
        if case.outcome in _SHOWS_NOTHING or case.raised_in == "tests":
            continue
        why = f"{case.id} {case.outcome} in the program: {case.message}"
        if evidence.solved is None or case.outcome != "error":
            return _blame_program(why)
        return _blame_tests(f"{why}; as the oracle solves the task in another test, this one misuses it", sure=False)
    return None


def _decide_by_oracle_episodes(evidence: _Evidence) -> RoutingDecision | None:
    """An oracle that falls short by itself, or meets goals only as loosely as they are published."""
    for case, episode in evidence.episodes:
        if episode.outcome == "success" and episode.strict < _STRICTLY_MET:
            missed = "; ".join(episode.shortfalls)
            return _blame_program(f"the goals count as met but strictly only {episode.strict:.2f}: {missed}")
        if case.outcome in ("passed", *_SHOWS_NOTHING) or episode.outcome in ("success", "stopped"):
            continue
        if not episode.motions and "add_goal" in evidence.context.simulation:
            return _blame_tests(f"{case.id} asks the oracle though nothing stands on the table: it has to reset first")
        why = f"{case.id}: the oracle ended in {episode.outcome}: {episode.detail}"
        if evidence.solved is None:
            return _blame_program(why)
        return _blame_tests(f"{why}; it solves the task in another test, so this one drives it differently", sure=False)
    return None


def _decide_by_task_words(evidence: _Evidence) -> RoutingDecision | None:
    """A program that runs well but may not be that of the task: a failed test may then be right."""
    if evidence.failed and (fault := evidence.find_static_finding("simulation", _OTHER_TASK)):
        return _blame_program(fault)
    if not evidence.failed or evidence.solved is None:
        return None
    words = read_task_words(evidence.context.task, evidence.context.scene)
    if unmet := words.find_violations(evidence.solved.motions):
        return _blame_program(f"the goals are met, the task is not: {'; '.join(unmet)}")
    doubt = next(_doubts_about_solved_program(evidence, evidence.solved), "")
    return _blame_program(doubt, sure=False) if doubt else None


def _doubts_about_solved_program(evidence: _Evidence, episode: Episode) -> Iterator[str]:
    """Signs that a program whose goals were met is wrong."""
    if not episode.actions:
        yield "the goals are met before the robot does anything"
    in_photo: dict[str, list[tuple[float, float]]] = {}  # x, y (m) of the objects of each asset
    for item in json.loads(evidence.context.scene or "{}").get("objects", ()):
        in_photo.setdefault(item["asset"], []).append((item["position"][0], item["position"][1]))
    for asset, places in in_photo.items():
        starts = [motion.start[:2] for motion in episode.motions if motion.asset == asset]
        if len(starts) > len(places):
            yield f"there are {len(starts)} of {asset}, the photo shows {len(places)}"
        elif any(min(math.dist(place, start) for place in places) > _SAME_PLACE for start in starts):
            yield f"{asset} does not begin where the photo shows it"
    counts = Counter(motion.asset for motion in episode.motions)
    for asset, moves in Counter(action.asset for action in episode.actions if action.asset).items():
        goals = sum(asset in goal.goal for goal in episode.goals)
        if moves > max(1, counts[asset]) and goals > 1:
            yield f"{goals} goals ask for {asset}, which the robot moves {moves} times"
    if fault := evidence.find_static_finding("simulation", ("reward_sum", "unknown_argument")):
        yield fault


def _decide_against_tests(evidence: _Evidence) -> RoutingDecision:
    """No evidence against the program: the tests are in error, or expect more than the task says."""
    if not evidence.failed:
        message = f"the tests as a whole are {evidence.report.outcome}: {evidence.report.message}"
        return _blame_tests(message, sure=False)
    first = evidence.failed[0]
    said = f"{first.id} {first.outcome}: {first.message}"
    if first.outcome != "failed":
        return _blame_tests(f"{said}, in the tests themselves")
    if evidence.solved is None:
        return _blame_tests(f"{said}, in tests that never let the oracle finish", sure=False, expectation=True)
    understood = bool(read_task_words(evidence.context.task, evidence.context.scene).relations)
    also = " and does all that the task's words ask for" if understood else ""
    return _blame_tests(f"{said}, although the oracle meets every goal{also}", sure=understood, expectation=True)
