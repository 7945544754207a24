"""Segment a photo by depth: the objects on the table, cut at jumps and creases. No weights."""

from dataclasses import dataclass

from grs_agents.perception.configuration import DEFAULT, Segmentation
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.types import Candidate, RGBDFrame, TableFrame
from grs_agents.toolkit import ToolContext


@dataclass(frozen=True)
class Request:
    """A frame, the table in it, and constants; this tool needs no model."""

    frame: RGBDFrame
    table: TableFrame
    model: str | None = None
    config: Segmentation = DEFAULT.segmentation


@dataclass(frozen=True)
class Result:
    """The candidates, in the table's frame."""

    candidates: tuple[Candidate, ...]


def run(request: Request, context: ToolContext) -> Result:
    """Segment and measure."""
    labels = segment_objects_on_table(request.frame, request.table, request.config)
    return Result(measure_candidates(request.frame, request.table, labels))
