"""Orders and results of the correspondence experiment."""

from pathlib import Path
from typing import Literal

from evals.benchmark.types import Order
from grs_agents.base import Frozen
from grs_agents.perception.types import MatchEvidence

Outcome = Literal["right", "wrong asset", "missed", "false alarm", "rightly none"]


class Method(Frozen):
    """A match tool, possibly ablated.

    Attributes:
        name: in tables.
        tool: its name in ``tools/``.
        ocr, sized: as in the tool's request.
        models: it calls a model, so results depend on model and run.
        worded, pictured: the model gets descriptions, and pictures, of the objects.
    """

    name: str
    tool: str
    ocr: bool = True
    sized: bool = True
    models: bool = False
    worded: bool = True
    pictured: bool = True


class MatchOrder(Frozen):
    """A scene to match, in a separate process.

    Attributes:
        scene: its place or recipe; its ``tool`` segments, or is empty for the true masks.
        method: of matching.
        model: by name; ``-`` without a model.
        run: number of the repetition, which is the seed too.
        settings: of the configuration, as for ``--set``.
    """

    scene: Order
    method: Method
    model: str = "-"
    run: int = 0
    settings: tuple[str, ...] = ()

    @property
    def stem(self) -> str:
        """Stem of its file names."""
        model = "".join(letter if letter.isalnum() else "_" for letter in self.model)
        return f"{self.scene.name}-{self.method.name}-{model}-{self.run}"


class ScoredAnswer(Frozen):
    """A candidate with its match.

    Attributes:
        id: its number.
        truth: library name; empty if the library lacks the object; ``None`` if it is no object.
        answer: of the tool.
        outcome: the comparison of both.
        visible: visible share of the object, if known.
        crop: picture file, relative to the output folder.
    """

    id: int
    truth: str | None
    answer: MatchEvidence
    outcome: Outcome
    visible: float | None = None
    crop: str = ""


class Matching(Frozen):
    """The result of matching a scene.

    Attributes:
        order: the order.
        answers: of the candidates.
        unseen: assets without a candidate, though they are visible enough.
        input_tokens, output_tokens: of all model calls.
        cpu_seconds: of the tool, on a single core.
        error: reason of missing answers.
    """

    order: MatchOrder
    answers: tuple[ScoredAnswer, ...] = ()
    unseen: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    cpu_seconds: float = 0.0
    error: str = ""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Right matches, wrong matches, and missed assets (a wrong match counts as both of the latter)."""
        outcomes = [answer.outcome for answer in self.answers]
        right, wrong = outcomes.count("right"), outcomes.count("wrong asset")
        return right, wrong + outcomes.count("false alarm"), wrong + outcomes.count("missed") + self.unseen


def f1_precision_recall(counts: tuple[int, int, int]) -> tuple[float, float, float]:
    """F1, precision and recall of counts; 1 where there was nothing to match and nothing was matched."""
    right, wrong, missed = counts
    f1 = 2 * right / (2 * right + wrong + missed) if right + wrong + missed else 1.0
    return f1, right / (right + wrong) if right + wrong else 1.0, right / (right + missed) if right + missed else 1.0


def matching_file(out: Path, order: MatchOrder) -> Path:
    """File of an order's outcome."""
    return out / "matchings" / f"{order.stem}.json"
