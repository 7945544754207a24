"""Read the evidence as the router and the fixers get it: static findings, tests, the robot's episodes, the audit."""

import re
from dataclasses import dataclass

_CASE = re.compile(
    r"^(?P<id>[A-Za-z_][\w.]*): (?P<outcome>failed|error|skipped|expected_failure|no_assertion|timeout|crashed"
    r"|exited|memory|output_limit|scratch_limit|thread_limit|limit|not_run|missing|extra|duplicate|replaced|tampered"
    r"|forged)(?: \(raised in (?P<where>\w+)\))?(?:: (?P<message>.*))?$"
)
_STATIC = re.compile(r"^(?P<program>simulation|tests) line \d+: (?P<message>\w+: .*)$")
_SCORE = re.compile(
    r"^published: (?P<published>-?\d+(?:\.\d+)?)  strict: (?P<strict>\d+(?:\.\d+)?)  steps: ",
    re.MULTILINE,
)
_MOVED = re.compile(r"^  (?P<asset>\S+) #\d+ \([^)]*\) -> ")
_ERROR = re.compile(r"^\s*(?:[\w.]*\.)?(?P<type>[A-Z]\w*(?:Error|Exception|Exit|Interrupt)): (?P<message>.*)$")
_FINDING = re.compile(r"^- (?P<check>\w+): FAILED: (?P<detail>.*)$")
_SOLVED = 0.99
"""As ``sim.goals.scores.SOLVED``, which this layer does not import."""


@dataclass(frozen=True)
class FailedTestCase:
    """A test that did not pass."""

    id: str
    outcome: str
    where: str  # the program that raised the final error; empty for a failed assertion
    message: str


@dataclass(frozen=True)
class OracleEpisode:
    """Result of the robot's episode."""

    outcome: str  # e.g. `step_limit`
    published: float  # the reward that the program paid
    strict: float  # score at the end, 0..1
    detail: str  # the sentence that explains it
    objects: tuple[str, ...]  # asset names concerned
    moved: tuple[str, ...]  # asset names of the moved objects

    @property
    def has_solved_task(self) -> bool:
        """Whether all goals hold, for a reward of 1."""
        return self.outcome == "success" and self.strict >= _SOLVED and abs(self.published - 1) <= 1 - _SOLVED


@dataclass(frozen=True)
class Evidence:
    """A parsed report."""

    text: str  # the whole of it
    static: tuple[tuple[str, str], ...]  # (program, message) of each static finding
    cases: tuple[FailedTestCase, ...]  # the tests that did not pass
    oracles: tuple[OracleEpisode, ...]  # each distinct episode
    errors: tuple[tuple[str, str], ...]  # (type, message) of each exception, in order
    where: str  # the program that an import of it ended in; empty where tests ran
    findings: dict[str, str]  # failed checks of the audit, with their measurements

    @property
    def shortfalls(self) -> tuple[OracleEpisode, ...]:
        """The episodes in which the oracle itself fell short."""
        return tuple(oracle for oracle in self.oracles if not oracle.has_solved_task and oracle.outcome != "stopped")


def parse_report_evidence(text: str) -> Evidence:
    """Parse a report; fields that it lacks stay empty."""
    lines = text.splitlines()
    raised = re.search(r"^raised in: (\w+)", text, re.MULTILINE)
    return Evidence(
        text=text,
        static=tuple((match["program"], match["message"]) for match in map(_STATIC.match, lines) if match),
        cases=tuple(
            FailedTestCase(*(match[name] or "" for name in ("id", "outcome", "where", "message")))
            for match in map(_CASE.match, lines)
            if match
        ),
        oracles=tuple(
            map(_parse_episode, re.findall(r"^== oracle episode.*\n((?:(?!== ).*\n?)*)", text, re.MULTILINE))
        ),
        errors=tuple((match["type"], match["message"]) for match in map(_ERROR.match, lines) if match),
        where=raised[1] if raised else "",
        findings={match["check"]: match["detail"] for match in map(_FINDING.match, lines) if match},
    )


def _parse_episode(section: str) -> OracleEpisode:
    """Parse a section with the heading ``== oracle episode``."""
    pairs = (line.partition(": ") for line in section.splitlines() if not line.startswith(" "))
    values = {key: value for key, _, value in pairs}
    score = _SCORE.search(section)
    return OracleEpisode(
        outcome=values.get("outcome", ""),
        published=float(score["published"]) if score else 0.0,
        strict=float(score["strict"]) if score else 0.0,
        detail=values.get("detail", ""),
        objects=tuple(filter(None, values.get("concerns", "").split(", "))),
        moved=tuple(match["asset"] for match in map(_MOVED.match, section.splitlines()) if match),
    )
