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
    """How the oracle fared once.

    Attributes:
        outcome: e.g. ``step_limit``.
        steps: actions taken.
        most: actions allowed.
        detail: the sentence that explains it.
        objects: asset names concerned.
    """

    outcome: str
    steps: int
    most: int
    detail: str
    objects: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """What a report says.

    Attributes:
        text: the whole report.
        cases: the tests that did not pass.
        oracles: the oracle's episodes that fell short.
        solved: how many episodes reached success.
        errors: (type, message) of each exception, in order.
        where: the program that the first failure came from: ``simulation``, ``tests``, ``library`` or empty.
        findings: failed checks of the audit and what they measured.
    """

    text: str
    cases: tuple[Case, ...]
    oracles: tuple[Oracle, ...]
    solved: int
    errors: tuple[tuple[str, str], ...]
    where: str
    findings: dict[str, str]


def read_evidence(text: str) -> Evidence:
    """Take a report apart; whatever it does not hold is left empty."""
    cases: list[Case] = []
    oracles: list[Oracle] = []
    errors: list[tuple[str, str]] = []
    findings: dict[str, str] = {}
    for line in text.splitlines():
        case, oracle, finding, error = _CASE.match(line), _ORACLE.search(line), _FINDING.match(line), _ERROR.match(line)
        if oracle:
            names = tuple(re.findall(r"[\"']([^\"']+)[\"']", oracle["objects"] or ""))
            oracles.append(
                Oracle(oracle["outcome"], int(oracle["steps"]), int(oracle["most"]), oracle["detail"], names)
            )
        elif finding:
            findings[finding["check"]] = finding["detail"]
        elif case and case["outcome"] != "passed":
            cases.append(Case(case["id"], case["outcome"], case["where"] or "", case["message"] or ""))
        elif error:
            errors.append((error["type"], error["message"]))
    raised = re.search(r"raised in:? (\w+)", text)
    return Evidence(
        text=text,
        cases=tuple(cases),
        oracles=tuple(oracle for oracle in oracles if oracle.outcome != "success"),
        solved=sum(oracle.outcome == "success" for oracle in oracles),
        errors=tuple(errors),
        where=raised[1] if raised else "",
        findings=findings,
    )
