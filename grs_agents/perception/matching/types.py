"""Request and result of a match tool."""

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
    upright: UprightBox  # its measured box, robot frame
    crop: Path  # its picture file
    points: int  # number of its pixels with depth


Ask = Callable[[Segment, Sequence[Shown], bool, bool], MatchEvidence]
"""Ask the model of the role ``match``. Arguments: the segment, the assets in the order of the prompt, with or without
its description, with or without its picture. Without a usable reply the answer is ``no_asset`` with the reason."""


@dataclass(frozen=True)
class MatchRequest:
    """The candidates of a photo."""

    segments: Sequence[Segment]
    frame: RGBDFrame  # the photo
    table: TableFrame  # the table in it
    ask: Ask  # asks a model, for the tools that need one
    seed: int = 0  # of the order in which assets are shown to a model
    model: str | None = None  # folder of the weights that a tool needs, if any
    ocr: bool = True  # read printed text, where the tool can
    sized: bool = True  # use size and place; false only in ablations
    index: str | None = None  # folder of an index of the library, if it is too large to compare every asset


@dataclass(frozen=True)
class MatchResult:
    """The answers of a match tool."""

    matches: dict[int, MatchEvidence]  # for each segment, by its number
    notes: tuple[str, ...] = ()  # for a reader of the scene


def require_match_request(request: Any) -> MatchRequest:
    """Narrow the type of a match tool's request."""
    assert isinstance(request, MatchRequest)
    return request
