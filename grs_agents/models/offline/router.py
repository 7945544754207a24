"""The router: parses a report (static findings, tests, the robot's episodes, the audit), and decides which of the two
programs is at fault, or whether the task is."""

import re
from dataclasses import dataclass, replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.prompt_text import PromptText, parse_scene_objects
from grs_agents.models.offline.task_reading import UnplannableTaskError, parse_clauses

_NO_CHECK = frozenset({"no_assertion", "skipped", "expected_failure"})
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
    physics: str  # failure of the arm to hold an object; empty without one
    moved: tuple[str, ...]  # asset names of the moved objects

    @property
    def has_solved_task(self) -> bool:
        """True if all goals hold, for a reward of 1."""
        return self.outcome == "success" and self.strict >= _SOLVED and abs(self.published - 1) <= 1 - _SOLVED


@dataclass(frozen=True)
class Evidence:
    """A parsed report."""

    text: str  # the whole report
    static: tuple[tuple[str, str], ...]  # (program, message) of each static finding
    cases: tuple[FailedTestCase, ...]  # the tests that did not pass
    oracles: tuple[OracleEpisode, ...]  # each distinct episode
    errors: tuple[tuple[str, str], ...]  # (type, message) of each exception, in order
    where: str  # the program whose import failed; empty if tests ran
    findings: dict[str, str]  # failed checks of the audit, with their measurements

    @property
    def shortfalls(self) -> tuple[OracleEpisode, ...]:
        """The episodes in which the oracle itself fell short."""
        return tuple(oracle for oracle in self.oracles if not oracle.has_solved_task and oracle.outcome != "stopped")


def parse_report_evidence(text: str) -> Evidence:
    """Parse a report; missing fields stay empty."""
    lines = text.splitlines()
    raised = re.search(r"^raised in: (\w+)", text, re.MULTILINE)
    oracles: list[OracleEpisode] = []
    for section in re.findall(r"^== oracle episode.*\n((?:(?!== ).*\n?)*)", text, re.MULTILINE):
        rows: list[str] = section.splitlines()
        pairs = (row.partition(": ") for row in rows if not row.startswith(" "))
        values = {key: value for key, _, value in pairs}
        score = _SCORE.search(section)
        episode = OracleEpisode(
            outcome=values.get("outcome", ""),
            published=float(score["published"]) if score else 0.0,
            strict=float(score["strict"]) if score else 0.0,
            detail=values.get("detail", ""),
            objects=tuple(filter(None, values.get("concerns", "").split(", "))),
            physics=values.get("physics", ""),
            moved=tuple(match["asset"] for match in map(_MOVED.match, rows) if match),
        )
        oracles.append(episode)
    return Evidence(
        text=text,
        static=tuple((match["program"], match["message"]) for match in map(_STATIC.match, lines) if match),
        cases=tuple(
            FailedTestCase(*(match[name] or "" for name in ("id", "outcome", "where", "message")))
            for match in map(_CASE.match, lines)
            if match
        ),
        oracles=tuple(oracles),
        errors=tuple((match["type"], match["message"]) for match in map(_ERROR.match, lines) if match),
        where=raised[1] if raised else "",
        findings={match["check"]: match["detail"] for match in map(_FINDING.match, lines) if match},
    )


def decide_what_to_fix(prompt: PromptText) -> str:
    """Reply to the ``route`` prompt: an explanation, then the verdict in a fenced block."""
    evidence = parse_report_evidence(prompt.section_body("test report"))
    program, tests = prompt.section_body("program"), prompt.section_body("tests")
    # The program is to blame for errors of the tests if its class lacks an attribute that the tests do not name, as
    # if `__init__` does not call the base: the first use of the object is in the tests, or below them.
    title = program_edits.find_task_class_name(program)
    cases: list[FailedTestCase] = []
    for case in evidence.cases:
        lacking = re.search(rf"'{title}' object has no attribute '(\w+)'", case.message)
        blamed = lacking is not None and lacking[1] not in tests
        cases.append(replace(case, where="simulation") if blamed else case)
    evidence = replace(evidence, cases=tuple(cases))
    task, used = prompt.section_json("task"), program_edits.find_asset_names(program)
    assets = {str(asset) for asset in task.get("assets-used", [])}
    objects = [obj for obj in parse_scene_objects(prompt.section_json("scene")) if obj.asset in assets]
    try:
        wanted = {obj.asset for clause in parse_clauses(task, objects) for obj in clause.moved}
    except UnplannableTaskError:
        wanted = set[str]()
    moved = {asset for oracle in evidence.oracles for asset in oracle.moved}
    solved = any(oracle.has_solved_task for oracle in evidence.oracles)
    neglected = (assets - used) | (wanted - moved if solved else set[str]())
    verdict, explanation = decide_verdict_from_evidence(evidence, tuple(sorted(neglected)))
    allowed = re.findall(r"\bfix_\w+", prompt.section_body("verdicts")) or [verdict]
    if verdict not in allowed:
        verdict, explanation = allowed[0], f"{explanation} As {verdict} is not left to try, {allowed[0]} is next."
    return f"{explanation}\n\n```\n{verdict}\n```"


def decide_verdict_from_evidence(evidence: Evidence, neglected: tuple[str, ...] = ()) -> tuple[str, str]:
    """Decide the verdict from the evidence.

    The tests are at fault if a check finds it, or if they fail although the oracle solved a program that does as the
    task says. The task is if its words are unclear or the arm cannot hold an object. Otherwise the program is at fault.

    Args:
        evidence: the parsed report.
        neglected: the assets that the task's words move and the program does not.

    Returns:
        Verdict and reason.
    """
    against = dict(reversed(evidence.static))
    for program, verdict in (("simulation", "fix_code"), ("tests", "fix_test")):
        if program in against:
            return verdict, f"A check of the {program} that needs no run finds: {against[program]}."
        if evidence.where == program:
            error = ": ".join(evidence.errors[-1]) if evidence.errors else "see the report"
            return verdict, f"No test ran, the fault lies in the {program}: {error}."
    case = next((case for case in evidence.cases if case.where or case.outcome in _NO_CHECK), None)
    if case is not None:
        verdict = "fix_test" if case.where in ("tests", "") else "fix_code"
        return verdict, f"{case.id} ended as {case.outcome}: {case.message or 'it checks nothing'}."
    if evidence.findings and all(check.startswith("tests_") for check in evidence.findings):
        about = "; ".join(f"{check}: {detail}" for check, detail in evidence.findings.items())
        return "fix_test", f"The audit finds fault with the tests alone: {about}."
    if neglected:
        return "fix_code", f"The task's words move {', '.join(neglected)}, which the robot did not: the goals lack it."
    words = evidence.findings.get("words", "differ,")
    if not words.startswith("differ,"):
        return "fix_task", f"The words of the task are at fault: {words}."
    if evidence.shortfalls:
        oracle = evidence.shortfalls[0]
        if oracle.physics:
            return "fix_task", f"No program changes the physics: {oracle.physics}."
        return "fix_code", f"The oracle ended in {oracle.outcome}, strict score {oracle.strict:.2f}: {oracle.detail}."
    if evidence.cases:
        case = evidence.cases[0]
        return (
            "fix_test",
            f"The oracle solved what the task asks for; {case.id} expects something else: {case.message}.",
        )
    if re.search(r"^(?:no_tests|load_tests): ", evidence.text, re.MULTILINE):
        return "fix_test", "There are no tests that count."
    findings = "; ".join(f"{check}: {detail}" for check, detail in evidence.findings.items())
    return "fix_code", f"The audit fails: {findings or 'see the report'}."
