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
"""A score from which a task counts as solved."""


@dataclass(frozen=True)
class FailedTestCase:
    """One test that did not pass."""

    id: str
    outcome: str
    where: str  # the program that raised what ended it; empty for a failed assertion
    message: str


@dataclass(frozen=True)
class Oracle:
    """How the robot fared in one episode."""

    outcome: str  # e.g. `step_limit`
    published: float  # the reward that the program paid
    strict: float  # what held at the end, 0..1
    detail: str  # the sentence that explains it
    objects: tuple[str, ...]  # asset names concerned
    moved: tuple[str, ...]  # asset names of what was moved

    @property
    def has_solved_task(self) -> bool:
        """Whether everything that the program asks for was reached, for a reward of 1."""
        return self.outcome == "success" and self.strict >= _SOLVED and abs(self.published - 1) <= 1 - _SOLVED


@dataclass(frozen=True)
class Evidence:
    """What a report says."""

    text: str  # the whole of it
    static: tuple[tuple[str, str], ...]  # (program, message) of what was found without running it
    cases: tuple[FailedTestCase, ...]  # the tests that did not pass
    oracles: tuple[Oracle, ...]  # each distinct episode
    errors: tuple[tuple[str, str], ...]  # (type, message) of each exception, in order
    where: str  # the program that an import of it ended in; empty where tests ran
    findings: dict[str, str]  # failed checks of the audit and what they measured

    @property
    def shortfalls(self) -> tuple[Oracle, ...]:
        """The episodes in which the oracle itself fell short."""
        return tuple(oracle for oracle in self.oracles if not oracle.has_solved_task and oracle.outcome != "stopped")


def parse_report_evidence(text: str) -> Evidence:
    """Take the evidence apart; whatever it does not hold is left empty."""
    lines = text.splitlines()
    raised = re.search(r"^raised in: (\w+)", text, re.MULTILINE)
    return Evidence(
        text=text,
        static=tuple((found["program"], found["message"]) for found in map(_STATIC.match, lines) if found),
        cases=tuple(_make_failed_case(found) for found in map(_CASE.match, lines) if found),
        oracles=tuple(
            map(_parse_episode, re.findall(r"^== oracle episode.*\n((?:(?!== ).*\n?)*)", text, re.MULTILINE))
        ),
        errors=tuple((found["type"], found["message"]) for found in map(_ERROR.match, lines) if found),
        where=raised[1] if raised else "",
        findings={found["check"]: found["detail"] for found in map(_FINDING.match, lines) if found},
    )


def _make_failed_case(found: re.Match[str]) -> FailedTestCase:
    return FailedTestCase(*(found[name] or "" for name in ("id", "outcome", "where", "message")))


def _parse_episode(section: str) -> Oracle:
    """The episode that a section with the heading ``== oracle episode`` tells of."""
    pairs = (line.partition(": ") for line in section.splitlines() if not line.startswith(" "))
    values = {key: value for key, _, value in pairs}
    score = _SCORE.search(section)
    return Oracle(
        outcome=values.get("outcome", ""),
        published=float(score["published"]) if score else 0.0,
        strict=float(score["strict"]) if score else 0.0,
        detail=values.get("detail", ""),
        objects=tuple(filter(None, values.get("concerns", "").split(", "))),
        moved=tuple(found["asset"] for found in map(_MOVED.match, section.splitlines()) if found),
    )
