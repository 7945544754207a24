"""The reason of a rejected run: what happened on the table, or else in the programs, in the words of the scene."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from grs_agents.audit.types import AuditReport
from grs_agents.graph.policies.types import read_episode
from grs_agents.perception.types import SceneDescription
from grs_agents.sandbox.protocol.report import TestCase, TestReport
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE
from grs_agents.sim.instance.episode import Episode
from grs_agents.sim.rollouts import Rollout

_LONGEST = 400
"""Characters of a reason: it is a headline, and audit.json and the report of the tests hold the rest."""
_MOST_READ = 4_000
"""Characters of a reason in which names are looked for."""
_ASSET = re.compile(r"(?<![\w.-])(?<![\w.-]/)(?P<asset>[\w.-]+(?:/[\w.-]+)*\.(?:urdf|xml|obj))(?P<id> #\d+)?")
"""A path from its start alone, so that the time is linear in the text."""
_ERROR_CLASS = re.compile(r"\bgrs_agents(?:\.\w+)+: ")
_FRAME = re.compile(r'File "(?P<file>[^"]*)", line (?P<line>\d+)[^\n]*\n +(?P<code>[^\n]+)')
_BARE = re.compile(r"(?:np\.)?(?:False_?|True_?) is not (?:true|false)$")
"""What unittest says of a condition, whatever the condition is."""


def explain_rejection(
    report: TestReport | None,
    audit: AuditReport | None,
    rollouts: Sequence[Rollout] = (),
    scene: SceneDescription | None = None,
) -> str:
    """Why the programs are not accepted, in one line.

    The trusted oracle's episodes come first, then those that the tests saw, then what tests or checks say themselves.

    Args:
        report: of the tests; None where there are none.
        audit: None where the tests did not pass.
        rollouts: of the trusted oracle; by default those of the audit.
        scene: names the objects; without one they are called by their assets.
    """
    failed = [case for case in report.cases if case.outcome not in ("passed", "not_run")] if report else []
    played = [rollout.episode for rollout in rollouts or (audit.rollouts if audit is not None else ())]
    causes = [*(episode.cause for episode in played)]
    if not played:
        causes += [episode.cause for episode in _rank_episodes(failed)]
    reason = next(filter(None, causes), "")
    if not reason and failed:
        episode = read_episode(failed[0].episode)
        solved = bool(played) or (episode is not None and episode.outcome == "success")
        name = failed[0].id.rpartition(".")[2]
        reason = f"{'the robot meets every goal, yet ' if solved else ''}{name}: {_describe_failed_test(failed[0])}"
    if not reason and report is not None and not report.all_passed:
        reason = report.message + _quote_line(report.traceback) if report.message else f"tests: {report.outcome}"
    if not reason and audit is not None:
        reason = next(_failed_checks(audit), "")
    named = _ASSET.sub(
        lambda match: _name_asset(match, scene), _ERROR_CLASS.sub("", " ".join(reason.split())[:_MOST_READ])
    )
    return named if len(named) <= _LONGEST else f"{named[:_LONGEST]}..."


def _rank_episodes(cases: Sequence[TestCase]) -> list[Episode]:
    """The episodes of failed tests; those first that ended by something other than the test."""
    episodes = list(filter(None, (read_episode(case.episode) for case in cases)))
    return sorted(episodes, key=lambda episode: episode.outcome == "stopped")


def _describe_failed_test(case: TestCase) -> str:
    """Its own message; where that says no more than that a condition is false, the line that asks."""
    if not case.message.startswith("AssertionError"):
        return (case.message or case.outcome) + _quote_line(case.traceback)
    said = case.message.removeprefix("AssertionError").lstrip(": ")
    standard, _, message = said.partition(" : ")
    if message:
        return message
    return ("it fails" if _BARE.match(standard) or not standard else standard) + _quote_line(case.traceback)


def _quote_line(traceback: str) -> str:
    """The last line of either program in a traceback, to put behind a message; empty without one."""
    frames = [frame for frame in _FRAME.finditer(traceback) if frame["file"] in (SIMULATION_FILE, TESTS_FILE)]
    if not frames:
        return ""
    program = "program" if frames[-1]["file"] == SIMULATION_FILE else "tests"
    return f" at line {frames[-1]['line']} of the {program}: {frames[-1]['code']}"


def _failed_checks(audit: AuditReport) -> Iterator[str]:
    for finding in audit.findings:
        if finding.passed:
            continue
        failures = finding.measured.partition("; ")[2] if finding.check == "instantiated" else ""
        yield failures.partition("; seed ")[0] or f"{finding.check}: {finding.detail}"


def _name_asset(match: re.Match[str], scene: SceneDescription | None) -> str:
    """An asset and its id as what the scene calls it; the id stays where the scene does not tell which is meant."""
    names = {item.name: item.asset for item in scene.objects} if scene is not None else {}
    called = [name for name, asset in names.items() if asset == match["asset"]]
    if len(called) == 1:
        kind = called[0].removesuffix("_1")
        return f"the {(called[0] if f'{kind}_2' in names else kind).replace('_', ' ')}"
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", Path(match["asset"]).stem).lower()
    return f"the {words}{match['id'] or ''}"
