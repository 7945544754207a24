"""The audit's findings."""

from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal

from grs_agents.base import Frozen, Pose, Vec3
from grs_agents.sim.rollouts import Rollout


class AuditFinding(Frozen):
    """Outcome of a check."""

    check: str
    passed: bool
    measured: str  # with numbers, names and units
    bound: str  # the requirement

    @property
    def detail(self) -> str:
        """Measurement and requirement in a line."""
        return f"{self.measured}; {self.bound}" if self.bound else self.measured

    @classmethod
    def from_fault_list(cls, check: str, faults: Iterable[str], otherwise: str, bound: str) -> "AuditFinding":
        """Make a finding that passes if there are no faults; ``otherwise`` is then its measurement."""
        text = join_first_distinct(faults)
        return cls(check=check, passed=not text, measured=text or otherwise, bound=bound)


def join_first_distinct(texts: Iterable[str]) -> str:
    """Different texts, the first four of them."""
    different = list(dict.fromkeys(texts))
    more = f" and {len(different) - 4} more" if len(different) > 4 else ""
    return "; ".join(different[:4]) + more


class Change(Frozen):
    """An object that is not at its pose in the photo."""

    seed: int  # the task instance it was seen in
    asset: str
    position: Vec3  # in the instance (m, robot frame)
    photo: Vec3 | None  # nearest position of the asset in the photo, if it shows the asset
    distance: float | None  # metres between the two in the table plane, if the photo shows the asset
    turned: float | None = None  # degrees between the two orientations, if the photo shows the asset
    wanted: Pose | None = None  # pose in the authors' prompt (m, robot frame), if the photo shows the asset
    reason: str = ""  # measured reason to leave the photo's pose; empty if there is none


WordsVerdict = Literal["agree", "differ", "not_judged"]
BY_GOALS: Final = "goals"
"""Author and judge of words that trusted code makes of the goals."""


class JudgedWords(Frozen):
    """A verdict on an author's words, which stand beside the sentence of the goals."""

    verdict: WordsVerdict
    by: str  # the model that judged, `offline` for the rules, `grs` where nobody was asked
    why: str


class Instruction(JudgedWords):
    """Words that tell a robot what to do, with the verdict on them."""

    text: str


class AuditReport(Frozen):
    """Why a run is accepted or not; measured on task instances by trusted code alone."""

    accepted: bool
    findings: tuple[AuditFinding, ...]  # a finding for each check
    changes: tuple[Change, ...]  # every position not taken from the photo
    rollouts: tuple[Rollout, ...]  # the trusted oracle's episode for each seed
    rewards: tuple[float, ...]  # the reward of each rollout
    about: str = ""  # scope of the verdict, a sentence or two
    unforeseen_seeds: tuple[int, ...] = ()  # more that were audited; they follow from the text of the programs
    # statement of the goals by trusted code, of the first seed; empty if a check before it fails
    sentence: str = ""
    vague: str = ""  # the same without names of single objects
    words: JudgedWords | None = None  # on the task's description; None if there is none, or a check before it fails

    def words_as_json(self, description: str) -> dict[str, Any]:
        """``sentence`` and ``instructions`` of a ``task.json``; empty without a sentence.

        Instructions by how much they say: ``vague``, ``default`` (the author's words, ``description``) and
        ``specific``, each with a verdict.
        """
        if not self.sentence:
            return {}
        made = {"verdict": "agree", "by": BY_GOALS, "why": "made of the goals by trusted code"}
        judged = {} if self.words is None else {"default": {**self.words.model_dump(), "text": description}}
        texts = {"vague": {**made, "text": self.vague}, **judged, "specific": {**made, "text": self.sentence}}
        instructions = {name: Instruction.model_validate(fields) for name, fields in texts.items()}
        return {
            "sentence": self.sentence,
            "instructions": {name: item.model_dump(mode="json") for name, item in instructions.items()},
        }

    def with_findings(self, further: Sequence[AuditFinding]) -> "AuditReport":
        """The report with more findings; accepted if they pass, too."""
        accepted = self.accepted and all(finding.passed for finding in further)
        return self.model_copy(update={"findings": (*self.findings, *further), "accepted": accepted})

    @property
    def failures(self) -> tuple[AuditFinding, ...]:
        """The findings of the checks that do not hold."""
        return tuple(finding for finding in self.findings if not finding.passed)


ProgramKind = Literal["simulation", "tests"]
StaticFindingKind = Literal[
    "syntax",
    "import",
    "unknown_name",
    "unknown_argument",
    "wrong_arguments",
    "endless_loop",
    "unknown_asset",
    "asset_not_in_task",
    "asset_unused",
    "object_without_goal",
    "reward_sum",
    "class_missing",
    "base_call_missing",
    "no_tests",
    "no_assertion",
]


class StaticFinding(Frozen):
    """A fault that shows without a run."""

    program: ProgramKind  # which of the two programs it blames
    line: int  # of that program, from 1
    kind: StaticFindingKind
    message: str  # a sentence with the names concerned, and the nearest right names
