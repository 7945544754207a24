"""What a match tool is given and what it answers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grs_agents.perception.types import Mask, MatchEvidence, RGBDFrame, Shown, TableFrame, UprightBox


@dataclass(frozen=True)
class Segment:
    """A candidate to be matched."""

    id: int  # its number
    mask: Mask  # (H, W) its pixels
    upright: UprightBox  # the box measured of it, robot frame
    crop: Path  # picture file of it
    points: int  # how many of its pixels have a depth


Ask = Callable[[Segment, Sequence[Shown], bool, bool], MatchEvidence]
"""Ask the model of the role ``match``: about a segment, among assets in this order, with its description or not, with
its picture or not. A model that gives no usable reply answers ``no_asset`` with what was wrong as the reason."""


@dataclass(frozen=True)
class MatchRequest:
    """The candidates of a photo."""

    segments: Sequence[Segment]  # what is to be matched
    frame: RGBDFrame  # frame, table: the photo and its pose
    table: TableFrame
    ask: Ask  # asks a model, for the tools that need one
    seed: int = 0  # of the order in which assets are shown to a model
    model: str | None = None  # folder of the weights that a tool needs, if any
    ocr: bool = True  # read what is printed, where a tool can
    sized: bool = True  # go by size and place; false only to measure what they are worth
    index: str | None = None  # folder of an index of the library, for one too large to compare everything


@dataclass(frozen=True)
class MatchResult:
    """One answer for each segment, by its number; and what a reader of the scene should know."""

    matches: dict[int, MatchEvidence]
    notes: tuple[str, ...] = ()


def require_match_request(request: Any) -> MatchRequest:
    """The request of a match tool as what it is."""
    assert isinstance(request, MatchRequest)
    return request
