"""Request and result of a match tool."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grs_agents.perception.types import Mask, MatchEvidence, RGBDFrame, Shown, TableFrame, UprightBox


@dataclass(frozen=True)
class Segment:
    """A candidate to be matched."""

    id: int  # its number
    mask: Mask  # (H, W) its pixels
    upright: UprightBox  # its measured box, robot frame
    crop: Path  # its picture file
    points: int  # number of its pixels with depth


BY_FEATURES = "match_features"
"""Method of the answers that measured features alone gave, size among them."""
Ask = Callable[[Sequence[Segment], Sequence[Shown]], Mapping[int, MatchEvidence]]
"""Ask the model of the role ``match`` about segments, among assets in the order of the prompt. The answers are by
number; there is none without a usable reply."""


@dataclass(frozen=True)
class MatchRequest:
    """The candidates of a photo."""

    segments: Sequence[Segment]
    frame: RGBDFrame  # the photo
    table: TableFrame  # the table in it
    ask: Ask | None = None  # asks a model that sees, if there is one
    seed: int = 0  # of random views
    model: str | None = None  # folder of the weights that a tool needs, if any
    ocr: bool = True  # read printed text, where the tool can
    sized: bool = True  # use size and place; false only in ablations
    index: str | None = None  # folder of an index of the library, if it is too large to compare every asset


@dataclass(frozen=True)
class MatchResult:
    """The answers of a match tool."""

    matches: dict[int, MatchEvidence]  # for each segment, by its number
    notes: tuple[str, ...] = ()  # for a reader of the scene
