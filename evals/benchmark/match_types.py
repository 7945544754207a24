"""What is asked and found when correspondence is measured."""

from pathlib import Path
from typing import Literal

from evals.benchmark.types import Order
from grs_agents.base import Frozen
from grs_agents.perception.types import MatchEvidence

Outcome = Literal["right", "wrong asset", "missed", "false alarm", "rightly none"]


class Method(Frozen):
    """A way to match: a match tool, with what an ablation takes away from it.

    Attributes:
        name: as tables call it.
        tool: by its name in ``tools/``.
        ocr, sized: as the tool's request has them.
        models: it asks a model, so that models and runs make a difference.
    """

    name: str
    tool: str
    ocr: bool = True
    sized: bool = True
    models: bool = False


class MatchOrder(Frozen):
    """One scene to match, in a process of its own.

    Attributes:
        scene: where it is or how it is made; its ``tool`` segments, or is empty for the true masks.
        method: how.
        model: by name; ``-`` where none is asked.
        run: number of the repetition, which is the seed too.
        settings: of the configuration, as ``--set`` takes them.
    """

    scene: Order
    method: Method
    model: str = "-"
    run: int = 0
    settings: tuple[str, ...] = ()

    @property
    def stem(self) -> str:
        """What its files are called."""
        model = "".join(letter if letter.isalnum() else "_" for letter in self.model)
        return f"{self.scene.name}-{self.method.name}-{model}-{self.run}"


class ScoredAnswer(Frozen):
    """One candidate.

    Attributes:
        id: its number.
        truth: library name; empty for what the library lacks; ``None`` for what is no object.
        answer: of the tool.
        outcome: of both.
        visible: share of the object that is seen, where that is known.
        crop: picture file, relative to the output folder.
    """

    id: int
    truth: str | None
    answer: MatchEvidence
    outcome: Outcome
    visible: float | None = None
    crop: str = ""


class Matching(Frozen):
    """What became of a scene.

    Attributes:
        order: what was asked.
        answers: of the candidates.
        unseen: assets that no candidate shows, though they are visible enough.
        input_tokens, output_tokens: of all model calls.
        cpu_seconds: of the tool, on one core.
        error: why there are no answers.
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
        """Right matches, wrong ones, and assets that were not matched (a wrong match counts as both)."""
        outcomes = [one.outcome for one in self.answers]
        right, other = outcomes.count("right"), outcomes.count("wrong asset")
        return right, other + outcomes.count("false alarm"), other + outcomes.count("missed") + self.unseen


def f1_precision_recall(counts: tuple[int, int, int]) -> tuple[float, float, float]:
    """F1, precision and recall of counts; 1 where there was nothing to match and nothing was matched."""
    right, wrong, missed = counts
    f1 = 2 * right / (2 * right + wrong + missed) if right + wrong + missed else 1.0
    return f1, right / (right + wrong) if right + wrong else 1.0, right / (right + missed) if right + missed else 1.0


def matching_file(out: Path, order: MatchOrder) -> Path:
    """Where the outcome of an order is kept."""
    return out / "matchings" / f"{order.stem}.json"
