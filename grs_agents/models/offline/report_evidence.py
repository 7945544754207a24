"""Read a test report as the router and the fixers get it: what failed, where it was raised, how the oracle fared."""

import re
from dataclasses import dataclass

_CASE = re.compile(
    r"^(?P<id>[A-Za-z_][\w.]*): (?P<outcome>passed|failed|error|skipped|expected_failure|no_assertion|timeout|crashed"
    r"|exited|memory|output_limit|scratch_limit|thread_limit|limit|not_run|missing|extra|duplicate|replaced|tampered"
    r"|forged)"
    r"(?: \(raised in (?P<where>\w+)\))?(?:: (?P<message>.*))?$"
)
_ORACLE = re.compile(
    r"oracle: outcome=(?P<outcome>\w+) reward=(?P<reward>[-\d.]+|None) steps=(?P<steps>\d+)/(?P<most>\d+) "
    r"detail=(?P<detail>.*?)(?: objects=\[(?P<objects>.*)\])?$"
)
_ERROR = re.compile(r"^\s*(?:[\w.]*\.)?(?P<type>[A-Z]\w*(?:Error|Exception|Exit|Interrupt)): (?P<message>.*)$")
_FINDING = re.compile(r"^- (?P<check>\w+): FAILED: (?P<detail>.*)$")


@dataclass(frozen=True)
class Case:
    """One test that did not pass."""

    id: str
    outcome: str
    where: str
    message: str


@dataclass(frozen=True)
class Oracle:
    """How the oracle fared once."""

    outcome: str  # e.g. `step_limit`
    steps: int  # actions taken
    most: int  # actions allowed
    detail: str  # the sentence that explains it
    objects: tuple[str, ...]  # asset names concerned


@dataclass(frozen=True)
class Evidence:
    """What a report says."""

    text: str  # the whole report
    cases: tuple[Case, ...]  # the tests that did not pass
    oracles: tuple[Oracle, ...]  # the oracle's episodes that fell short
    solved: int  # how many episodes reached success
    errors: tuple[tuple[str, str], ...]  # (type, message) of each exception, in order
    where: str  # the program that the first failure came from: `simulation`, `tests`, `library` or empty
    findings: dict[str, str]  # failed checks of the audit and what they measured


def parse_report_evidence(text: str) -> Evidence:
    """Take a report apart; whatever it does not hold is left empty."""
    cases: list[Case] = []
    oracles: list[Oracle] = []
    errors: list[tuple[str, str]] = []
    findings: dict[str, str] = {}
    for line in text.splitlines():
        if oracle := _ORACLE.search(line):
            oracles.append(_parse_oracle_line(oracle))
        elif finding := _FINDING.match(line):
            findings[finding["check"]] = finding["detail"]
        elif (case := _CASE.match(line)) and case["outcome"] != "passed":
            cases.append(Case(*(case[name] or "" for name in ("id", "outcome", "where", "message"))))
        elif error := _ERROR.match(line):
            errors.append((error["type"], error["message"]))
    raised = re.search(r"raised in:? (\w+)", text)
    short = tuple(oracle for oracle in oracles if oracle.outcome != "success")
    where = raised[1] if raised else ""
    return Evidence(text, tuple(cases), short, len(oracles) - len(short), tuple(errors), where, findings)


def _parse_oracle_line(line: re.Match[str]) -> Oracle:
    assets = tuple(re.findall(r"[\"']([^\"']+)[\"']", line["objects"] or ""))
    return Oracle(line["outcome"], int(line["steps"]), int(line["most"]), line["detail"], assets)
