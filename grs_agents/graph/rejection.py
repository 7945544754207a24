"""The reason of a rejected run: the events on the table, else in the programs, in the words of the scene."""

import re
from collections.abc import Sequence
from pathlib import Path

from grs_agents.audit.types import AuditReport
from grs_agents.graph.policies.types import read_episode
from grs_agents.perception.types import SceneDescription
from grs_agents.sandbox.protocol.report import TestCase, TestReport
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE
from grs_agents.sim.rollouts import Rollout

_LONGEST = 400
"""Characters of a reason, which is a headline: audit.json and the report of the tests hold the rest."""
_MOST_READ = 4_000
"""Characters of a reason that are searched for asset names."""
_ASSET = re.compile(r"(?<![\w.-])(?<![\w.-]/)(?P<asset>[\w.-]+(?:/[\w.-]+)*\.(?:urdf|xml|obj)(?!\w))(?P<id> #\d+)?")
"""Matches a path only at its start, so that the time is linear in the text."""
_UNKNOWN_ASSET = re.compile(r"\b(?:unknown|no) asset ")
"""Begin of a list of names of the library: there only the names as they are written help."""
_ERROR_CLASS = re.compile(r"\bgrs_agents(?:\.\w+)+: ")
_FRAME = re.compile(r'File "(?P<file>[^"]*)", line (?P<line>\d+)[^\n]*\n +(?P<code>[^\n]+)')
_BARE = re.compile(r"(?:np\.)?(?:False_?|True_?) is not (?:true|false)$")
"""The message of unittest for any false condition."""


def explain_rejection(
    report: TestReport | None,
    audit: AuditReport | None,
    rollouts: Sequence[Rollout] = (),
    scene: SceneDescription | None = None,
) -> str:
    """The reason why the programs are not accepted, in a line.

    The trusted oracle's episodes come first, then those of the tests, then the messages of tests or checks.

    Args:
        report: of the tests; None where there are none.
        audit: None where the tests did not pass.
        rollouts: of the trusted oracle; by default those of the audit.
        scene: names the objects; None: they are called by their assets.
    """
    failed = [case for case in report.cases if case.outcome not in ("passed", "not_run")] if report else []
    played = [rollout.episode for rollout in rollouts or (audit.rollouts if audit is not None else ())]
    causes = [episode.cause for episode in played]
    if not played:  # the episodes of failed tests; last those that the test itself ended
        seen = [episode for case in failed if (episode := read_episode(case.episode)) is not None]
        causes += [episode.cause for episode in sorted(seen, key=lambda episode: episode.outcome == "stopped")]
    reason = next(filter(None, causes), "")
    if not reason and failed:
        episode = read_episode(failed[0].episode)
        solved = bool(played) or (episode is not None and episode.outcome == "success")
        name = failed[0].id.rpartition(".")[2]
        reason = f"{'the robot meets every goal, yet ' if solved else ''}{name}: {_describe_failed_test(failed[0])}"
    if not reason and report is not None and not report.all_passed:
        reason = report.message + _quote_line(report.traceback) if report.message else f"tests: {report.outcome}"
    if not reason and audit is not None:
        finding = next((finding for finding in audit.findings if not finding.passed), None)
        if finding is not None:
            failures = finding.measured.partition("; ")[2] if finding.check == "instantiated" else ""
            reason = failures.partition("; seed ")[0] or f"{finding.check}: {finding.detail}"
    asset_by_name = {item.name: item.asset for item in scene.objects} if scene is not None else {}

    def name_asset(match: re.Match[str]) -> str:
        """The name in the scene if it is unique; else the words of the asset's name with the id."""
        names = [name for name, asset in asset_by_name.items() if asset == match["asset"]]
        if len(names) == 1:
            kind = names[0].removesuffix("_1")
            return f"the {(names[0] if f'{kind}_2' in asset_by_name else kind).replace('_', ' ')}"
        words = re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", Path(match["asset"]).stem).lower()
        return f"the {words}{match['id'] or ''}"

    named = _ERROR_CLASS.sub("", " ".join(reason.split())[:_MOST_READ])
    if not _UNKNOWN_ASSET.search(named):
        named = _ASSET.sub(name_asset, named)
    return named if len(named) <= _LONGEST else f"{named[:_LONGEST]}..."


def _describe_failed_test(case: TestCase) -> str:
    """The message of the test; of a bare false condition the line of the assertion."""
    if not case.message.startswith("AssertionError"):
        return (case.message or case.outcome) + _quote_line(case.traceback)
    words = case.message.removeprefix("AssertionError").lstrip(": ")
    standard, _, message = words.partition(" : ")
    if message:
        return message
    return ("it fails" if _BARE.match(standard) or not standard else standard) + _quote_line(case.traceback)


def _quote_line(traceback: str) -> str:
    """The last line of either program in a traceback, as a suffix of a message; empty if there is none."""
    frames = [frame for frame in _FRAME.finditer(traceback) if frame["file"] in (SIMULATION_FILE, TESTS_FILE)]
    if not frames:
        return ""
    program = "program" if frames[-1]["file"] == SIMULATION_FILE else "tests"
    return f" at line {frames[-1]['line']} of the {program}: {frames[-1]['code']}"
