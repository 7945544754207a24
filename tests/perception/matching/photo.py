"""A made photo as the matcher gets it."""

from pathlib import Path

import numpy as np

from evals.synthesis import Recipe, synthesise
from grs_agents.library.library import Library
from grs_agents.perception.matching.types import MatchRequest, Segment
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import MatchEvidence, RGBDFrame


def unasked(*_: object) -> dict[int, MatchEvidence]:
    """A model that must not be asked."""
    raise AssertionError("the model was asked")


def request_of(recipe: Recipe, library: Library, ocr: bool = True) -> tuple[MatchRequest, dict[int, str]]:
    """The segments of a synthesised photo by their true masks, and the names of their assets by segment."""
    made = synthesise(recipe, library)
    frame = RGBDFrame(made.rgb, made.depth.astype(np.float32), made.camera, Path("made"))
    table = find_table(frame, np.random.default_rng(0))
    truth = {one.id: one.asset for one in made.truth.objects}
    segments: list[Segment] = []
    names: dict[int, str] = {}
    for one in measure_candidates(frame, table, made.seen.labels):
        segments.append(Segment(one.id, one.mask, one.upright, Path("crop.png"), one.points))
        names[one.id] = truth[int(np.bincount(made.seen.labels[one.mask]).argmax())]
    return MatchRequest(segments, frame, table, unasked, ocr=ocr), names
