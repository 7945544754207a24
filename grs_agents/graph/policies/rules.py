"""The policy ``rules``: decides from typed findings, without a model, what is at fault: program, tests or task."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

from grs_agents.agents.types import Verdict
from grs_agents.audit.seed_and_override_checks import check_program
from grs_agents.graph.policies.task_word_checks import read_task_words
from grs_agents.graph.policies.types import (
    Cause,
    RoutingContext,
    RoutingDecision,
    are_words_unclear,
    list_stable_failures,
    read_episode,
)
from grs_agents.sandbox.protocol.report import TestCase
from grs_agents.sim.instance.episode import Episode, ObjectMotion
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER

_BROKEN_SOURCE = (
    *("syntax", "import", "unknown_name", "unknown_asset", "wrong_arguments", "endless_loop"),
    *("class_missing", "base_call_missing"),
)
_OTHER_TASK = ("asset_not_in_task", "asset_unused", "object_without_goal")
"""Static findings of a program that is not that of the task, however well it runs."""
_SHOWS_NOTHING = ("no_assertion", "skipped", "expected_failure", "missing", "extra", "duplicate", "replaced")
_MEDDLING = re.compile(
    r"\.(?:max_steps|goals|pos_eps|rot_eps|primitive) = .*|\.(?:add_object|add_goal|set_color|tie_objects)\(.*"
    r"|\b(?:mock|patch|MagicMock|Mock)\b[.(].*|\bEnvironment\([^)]*\b(?:seed|robot|budget|library)=.*"
    r"|[\"']pose[01][\"']:.*|\.resetBase\w+\(.*"
)
"""Changes that tests make to the task, the scene or the arm that they test."""
_MISUSE = re.compile(
    r"NameError|ImportError|ModuleNotFoundError|KeyError: \d"
    r"|AttributeError: '(?:Environment|Oracle|dict|list|tuple|str|int|float)' object"
)
"""Errors of tests that no program provokes."""
_STRICTLY_MET = 0.95
"""Least strict score of an episode whose goals are met."""
_REWARDED = 0.99
"""Least reward of an episode whose goals are met."""
_SAME_PLACE = 0.02
"""Greatest distance (m) of the start of an object from its place in the photo."""
_SAME_HEIGHT = 0.01
"""Greatest difference (m) of that height: an object that lies where it should stand differs by more."""
_SAME_SPOT = 0.05
"""Greatest distance (m) between a pick or place and the middle of an object of the photo that it is made at."""
_TURNED = 0.02
"""Least difference (m) by which the extents fit the photo better if x and y change places."""
_INFEASIBLE = ("target_too_small", "unreachable", "no_free_space", "no_seal", "would_tip", "no_grip")
"""Outcomes that no program may be able to change: the task has to be revised."""
_CALLED_BY_TESTS = re.compile(
    r'File "test_task_code\.py", line \d+, in \w+\n(?:    .*\n)+  File "task_code\.py", line \d+, in (?!__init__)'
)
"""Tests that call a method of the program, which the environment is to call."""
_LOOP = re.compile(r"^ +while\b", re.MULTILINE)
_WRONG_ARGUMENT = re.compile(r"NoneType|(?:positional|keyword) argument")


class Rules:
    """Decide from types: static findings, who raised an error, how the oracle fared, what the task's words ask for.

    The program is at fault if its source or its run is broken, if the oracle falls short, if goals are met only
    loosely, or if it succeeds at another task. The task is if its words are unclear, or if the arm cannot hold or reach
    an object where the photo shows it. Otherwise the tests are: they are in error, or expect more than the task says.
    A verdict that left the report as it was gives way to the opposite verdict.
    """

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Apply the first rule that matches; compare with the report of the decision before."""
        evidence = _Evidence(context)
        rules: tuple[Callable[[_Evidence], RoutingDecision | None], ...] = (
            _decide_by_audit,
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
        self.in_photo: list[dict[str, Any]] = json.loads(context.scene or "{}").get("objects", [])
        self.words = read_task_words(context.task, context.scene)

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
        """An episode in which the oracle met every goal, strictly if there is such, or None."""
        solved = [episode for _, episode in self.episodes if episode.outcome == "success"]
        return max(solved, key=lambda episode: episode.strict >= _STRICTLY_MET, default=None)

    @property
    def is_infeasible(self) -> bool:
        """Whether no episode succeeds, and an object does not fit or cannot be reached or held."""
        return self.solved is None and any(episode.outcome in _INFEASIBLE for _, episode in self.episodes)

    def explain_arm_failure(self, episode: Episode) -> str:
        """The arm's failure with an object that stands where the photo shows it; empty if nothing says so."""
        asset, why = episode.arm_failure
        if not asset and episode.outcome == "unreachable":
            asset, why = "".join(episode.objects[:1]), episode.detail
            shown = [item for item in self.in_photo if item["asset"] == asset]
            why = why if any(item.get("reachable") is False or "cannot_be_picked" in item for item in shown) else ""
        return "" if self.leaves_photo(asset, episode) else why

    def explain_disturbance(self, episode: Episode) -> str:
        """The bystanders that the arm knocks at places that the photo gives, not the program; empty without one."""
        knocked = [motion for motion in episode.motions if motion.moved and motion.object >= FIRST_BYSTANDER]
        spots = [(action, at) for action in episode.actions for at in (action.pick, action.place)]
        causes: list[str] = []
        for motion in knocked if spots and episode.outcome == "success" else ():
            action, at = min(spots, key=lambda spot: math.dist(spot[1][:2], motion.start[:2]))
            if all(math.dist(at[:2], item["position"][:2]) > _SAME_SPOT for item in self.in_photo):
                return ""  # a target of the program's choice
            causes.append(f"the arm moves {motion.asset} as it handles {action.asset} at ({at[0]:.2f}, {at[1]:.2f})")
        return "; ".join(causes)

    def leaves_photo(self, asset: str, episode: Episode) -> bool:
        """Whether an object of an asset of the photo begins elsewhere or in another pose than the photo shows."""
        shown = [item for item in self.in_photo if item["asset"] == asset]
        starts = [motion for motion in episode.motions if motion.asset == asset] if shown else []
        return any(all(_is_posed_otherwise(start, item) for item in shown) for start in starts)


def _is_posed_otherwise(motion: ObjectMotion, item: dict[str, Any]) -> bool:
    """Whether an object begins at another place, higher or lower, or turned by about 90 degrees."""
    place, size, extent = item["position"], item.get("size", (0, 0)), motion.extent
    away = math.dist(motion.start[:2], place[:2]) > _SAME_PLACE
    turned = abs(extent[0] - size[1]) + abs(extent[1] - size[0]) + _TURNED
    as_shown = abs(extent[0] - size[0]) + abs(extent[1] - size[1])
    return away or abs(motion.start[2] - place[2]) > _SAME_HEIGHT or (all(extent) and as_shown > turned)


def _blame_program(why: str, sure: bool = True) -> RoutingDecision:
    return RoutingDecision(verdict="fix_code", explanation=why, policy="rules", cause="wrong_program", sure=sure)


def _blame_tests(why: str, sure: bool = True, expectation: bool = False) -> RoutingDecision:
    cause: Cause = "wrong_expectation" if expectation else "tests_error"
    return RoutingDecision(verdict="fix_test", explanation=why, policy="rules", cause=cause, sure=sure)


def _blame_task(evidence: _Evidence, why: str) -> RoutingDecision:
    """The task is to be revised; the program has to work around it where the task stays."""
    verdict: Verdict = "fix_task" if "fix_task" in evidence.context.verdicts else "fix_code"
    return RoutingDecision(verdict=verdict, explanation=why, policy="rules", cause="wrong_task")


def _decide_by_audit(evidence: _Evidence) -> RoutingDecision | None:
    """A failed audit: of the words, of the tests alone, of a task that the arm cannot do, or of the program."""
    audit, verdicts = evidence.context.audit, evidence.context.verdicts
    if not evidence.context.audit_failed:
        return None
    failures = audit.failures if audit else ()
    if unclear := next(filter(are_words_unclear, failures), None):
        return _blame_task(evidence, f"the words of the task are at fault: {unclear.measured}")
    if "fix_code" not in verdicts:
        return _blame_tests("the audit finds fault with the tests alone")
    for rollout in audit.rollouts if audit else ():
        if rollout.episode.outcome != "success" and (why := evidence.explain_arm_failure(rollout.episode)):
            return _blame_task(evidence, f"in seed {rollout.seed} the arm cannot do what the task asks for: {why}")
        if near := evidence.explain_disturbance(rollout.episode):
            return _blame_task(evidence, f"in seed {rollout.seed} {near}")
    against = [finding for finding in failures if not finding.check.startswith("tests_")]
    if [finding.check for finding in against] == ["moved"]:  # the program does all that the words ask for
        return _blame_task(evidence, f"the task asks for too little: {against[0].detail}")
    return _blame_program("the tests pass but the audit of the task instances fails")


def _decide_by_load_failures(evidence: _Evidence) -> RoutingDecision | None:
    """Broken sources, and tests that did not run."""
    report = evidence.report
    if fault := evidence.find_static_finding("simulation", _BROKEN_SOURCE):
        return _blame_program(fault)
    if fault := evidence.find_static_finding("tests", (*_BROKEN_SOURCE, "no_tests")):
        return _blame_tests(fault)
    if report.cases:
        return None
    why = f"no test ran: {report.message} (raised in {report.raised_in or report.outcome})"
    if report.raised_in == "tests" or report.outcome in ("no_tests", "load_tests"):
        return _blame_tests(why)
    return _blame_program(why, sure=report.raised_in == "simulation")


def _decide_by_failed_cases(evidence: _Evidence) -> RoutingDecision | None:
    """Tests that change the task that they test, and errors and limits in the program."""
    if evidence.failed and (meddling := _MEDDLING.search(evidence.context.tests)):
        return _blame_tests(f"the tests change what they test: {meddling[0][:80]}", sure=False)
    for case in evidence.failed:
        if case.outcome in _SHOWS_NOTHING or case.raised_in == "tests":
            continue
        why = f"{case.id} {case.outcome} in the program: {case.message}"
        called_by_tests = _CALLED_BY_TESTS.search(case.traceback) is not None
        if called_by_tests and _WRONG_ARGUMENT.search(case.message):
            return _blame_tests(f"{why}; the tests call it themselves, with what it does not take", sure=False)
        if evidence.solved is None or case.outcome != "error":
            loops = case.outcome != "error" and _LOOP.search(evidence.context.tests)
            return _blame_program(why, sure=case.raised_in == "simulation" and not called_by_tests and not loops)
        return _blame_tests(f"{why}; as the oracle solves the task in another test, this one misuses it", sure=False)
    return None


def _decide_by_oracle_episodes(evidence: _Evidence) -> RoutingDecision | None:
    """An oracle that falls short by itself, or meets goals only as loosely as they are published."""
    solved = evidence.solved
    if solved is not None and solved.strict < _STRICTLY_MET:
        missed = "; ".join(solved.shortfalls)
        return _blame_program(f"the goals count as met but strictly only {solved.strict:.2f}: {missed}")
    for case, episode in evidence.episodes:
        if case.outcome in ("passed", *_SHOWS_NOTHING) or episode.outcome in ("success", "stopped"):
            continue
        if not episode.motions and "add_goal" in evidence.context.simulation:
            why = f"{case.id} asks the oracle though nothing stands on the table: it has to reset first"
            return _blame_tests(why, sure=".reset(" not in evidence.context.tests)
        why = f"{case.id}: the oracle ended in {episode.outcome}: {episode.detail}"
        if solved is not None:
            differently = "it solves the task in another test, so this one drives it differently"
            return _blame_tests(f"{why}; {differently}", sure=False)
        if fault := evidence.find_static_finding("simulation", _OTHER_TASK):
            return _blame_program(fault)
        if arm := evidence.explain_arm_failure(episode):
            return _blame_task(evidence, f"{case.id}: the arm cannot do what the task asks for: {arm}")
        return _blame_program(why, sure=all(action.asset for action in episode.actions))  # the oracle always picks
    return None


def _decide_by_task_words(evidence: _Evidence) -> RoutingDecision | None:
    """A program that runs well but may not be that of the task: a failed test may then be right."""
    if evidence.failed and (fault := evidence.find_static_finding("simulation", _OTHER_TASK)):
        return _blame_program(fault)
    if not evidence.failed:
        return None
    overrides = check_program(evidence.context.simulation)
    if not overrides.passed:
        return _blame_program(overrides.detail, sure=False)
    if evidence.solved is None:
        return None
    if unmet := evidence.words.find_violations(evidence.solved.motions):
        why = f"the goals are met, the task is not: {'; '.join(unmet)}"
        return _blame_program(why, sure=evidence.words.settles(evidence.solved.motions))
    doubt = next(_doubts_about_solved_program(evidence, evidence.solved), "")
    return _blame_program(doubt, sure=False) if doubt else None


def _doubts_about_solved_program(evidence: _Evidence, episode: Episode) -> Iterator[str]:
    """Signs that a program whose goals were met is wrong."""
    if not episode.actions:
        yield "the goals are met before the robot does anything"
    if episode.reward < _REWARDED:
        yield f"all goals are met, for a reward of {episode.reward:.2f}"
    yield from evidence.words.find_other_colors(episode.motions)
    yield from evidence.words.find_untimely_actions(episode.actions)
    places = Counter(item["asset"] for item in evidence.in_photo)
    for asset, shown in places.items():
        starts = sum(motion.asset == asset for motion in episode.motions)
        if starts > shown:
            yield f"there are {starts} of {asset}, the photo shows {shown}"
        elif starts < 1:
            yield f"{asset} of the task is not on the table"
        elif evidence.leaves_photo(asset, episode):
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
    settled = evidence.solved is not None and evidence.words.settles(evidence.solved.motions)
    if first.outcome != "failed":
        certain = _MISUSE.match(first.message) is not None or first.outcome in _SHOWS_NOTHING
        return _blame_tests(f"{said}, in the tests themselves", sure=certain)
    if evidence.solved is None:
        return _blame_tests(f"{said}, in tests that never let the oracle finish", sure=False, expectation=True)
    also = " and does all that the task's words ask for" if settled else ""
    return _blame_tests(f"{said}, although the oracle meets every goal{also}", sure=settled, expectation=True)
