"""Use the masks supplied with the scene: by a person, another program, or a data set."""

from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.reading.foreign_scene import read_foreign_masks
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.types import Candidate, RGBDFrame, TableFrame
from grs_agents.toolkit import ToolContext


@dataclass(frozen=True)
class Request:
    """A frame and the table in it; this tool needs no model."""

    frame: RGBDFrame
    table: TableFrame
    model: str | None = None


@dataclass(frozen=True)
class Result:
    """The candidates, in the table's frame, and notes on masks with too little depth."""

    candidates: tuple[Candidate, ...]
    notes: tuple[str, ...] = ()


def run(request: Request, context: ToolContext) -> Result:
    """Read and measure.

    Raises:
        InputError: the scene has no masks, or none with enough depth.
    """
    rows, columns = request.frame.depth.shape
    masks = read_foreign_masks(request.frame.source, (rows, columns))
    labels = masks.labels
    candidates = measure_candidates(request.frame, request.table, labels, given=True)
    kept = {int(labels[candidate.mask].max()) for candidate in candidates}
    lost = sorted(set(np.unique(labels).tolist()) - kept - {0})
    notes = [f"mask {number} has too little depth to be an object" for number in lost]
    if any(masks.names):
        candidates = tuple(replace(item, label=masks.names[int(labels[item.mask].max()) - 1]) for item in candidates)
        notes.append(f"names of the masks: object {', '.join(f'{item.id} is {item.label!r}' for item in candidates)}")
    return Result(candidates, tuple(notes))
