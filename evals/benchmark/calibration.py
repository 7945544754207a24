"""Calibration of match confidence, on scenes with objects that the library lacks."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from evals.benchmark.contact_sheet import Picture, write_picture, write_words
from evals.benchmark.ground_truth import read_labelled
from evals.benchmark.match_worker import first_of_same_look
from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError, InputError
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import rank_assets_per_segment
from grs_agents.perception.matching.types import MatchRequest, Segment
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Array, Candidate, RGBDFrame
from grs_agents.runs.metrics import Figure
from grs_agents.toolkit import ToolContext, load_tool

_PRODUCTS = Path(__file__).with_name("known_products.json")
"""Photos without a truth of their own, labelled by eye: column and row (pixels) of the objects that the shipped library
holds, and their assets. The library lacks everything else in these photos."""
_OWN = 0.7  # a segment shows the object to which at least this share of its pixels belongs
_BINS = 10


class NamedAsset(Frozen):
    """The best asset of a segment."""

    scene: str
    asset: str
    inputs: tuple[float, ...]  # of its confidence
    confidence: float
    right: bool
    known: bool  # the library holds the segment's asset


class _Fewer(Library):
    """A library that lacks some of its assets."""

    def __init__(self, whole: Library, gone: Collection[str]) -> None:
        super().__init__(*whole.roots)
        self._gone = gone

    def everyday_assets(self) -> tuple[Asset, ...]:
        return tuple(asset for asset in super().everyday_assets() if asset.name not in self._gone)


def name_assets(folder: Path, segment: str, context: ToolContext) -> list[NamedAsset]:
    """Segment a scene and name the best asset of each segment, with the whole library; and, if poses and assets of
    its objects are known, with a library that lacks every second of these assets.

    Raises:
        InputError: the scene's assets are unknown.
    """
    labelled = (folder / "truth.json").is_file()
    frame = read_labelled(folder).frame if labelled else read_scene(folder)
    table = find_table(frame, np.random.default_rng(0))
    tool, library = load_tool(segment), context.library
    try:
        candidates: Sequence[Candidate] = tool.run(tool.Request(frame=frame, table=table), context).candidates
    except GrsError:
        return []
    shown = (
        _true_assets_by_truth(folder, candidates) if labelled else _true_assets_by_eye(folder.name, frame, candidates)
    )
    segments = [
        Segment(candidate.id, candidate.mask, candidate.upright, Path(), candidate.points) for candidate in candidates
    ]
    request, half = MatchRequest(segments, frame, table), sorted({*shown.values()} - {""})[::2]
    named = _name_best_assets(folder.name, request, library, shown)
    fewer = _name_best_assets(folder.name, request, _Fewer(library, half), shown) if labelled else ()
    return [*named, *fewer]


def _name_best_assets(
    scene: str, request: MatchRequest, library: Library, shown: Mapping[int, str]
) -> Iterator[NamedAsset]:
    """The best asset of each segment that may be an object; ``shown`` holds the true assets by segment."""
    looks, held = first_of_same_look(library), {asset.name for asset in library.everyday_assets()}
    for number, (ranked, nothing) in rank_assets_per_segment(request, library).items():
        if ranked.names and not nothing:
            best, true = ranked.names[0], shown[number]
            right = true in held and looks[best] == looks[true]
            inputs = tuple(float(value) for value in ranked.confidence_inputs[0])
            yield NamedAsset(
                scene=scene,
                asset=best,
                inputs=inputs,
                confidence=ranked.confidences[0],
                right=right,
                known=true in held,
            )


def _true_assets_by_truth(folder: Path, candidates: Sequence[Candidate]) -> dict[int, str]:
    """The true asset of each segment, by number; empty without an asset."""
    scene = read_labelled(folder)
    assets = {item.id: item.asset for item in scene.truth.objects}
    shown: dict[int, str] = {}
    for candidate in candidates:
        counts = np.bincount(scene.labels[candidate.mask])
        label = int(counts.argmax())
        shown[candidate.id] = assets.get(label, "") if counts[label] >= _OWN * counts.sum() else ""
    return shown


def _true_assets_by_eye(name: str, frame: RGBDFrame, candidates: Sequence[Candidate]) -> dict[int, str]:
    products: Mapping[str, Sequence[tuple[int, int, str]]] = json.loads(_PRODUCTS.read_text(encoding="utf-8"))
    if name not in products:
        raise InputError(f"nobody says what {name} shows", f"add a truth.json, or name it in {_PRODUCTS.name}")
    shown = {candidate.id: "" for candidate in candidates}
    for column, row, asset in products[name]:
        shown.update({candidate.id: asset for candidate in candidates if candidate.mask[row, column]})
    return shown


def calibration_figures(named: Sequence[NamedAsset], least: float) -> list[Figure]:
    """The expected calibration error (Naeini et al. 2015), and the share of wrong assets among confident matches."""
    sure, right = _columns(named)
    high, taken = sure >= 0.9, sure >= least
    return [
        Figure(name="segments", value=float(len(named))),
        Figure(name="shown by the library", value=float(np.mean([asset.known for asset in named]))),
        Figure(name="calibration error", value=_calibration_error(sure, right), target=0.08),
        Figure(name="calibration error above 0.5", value=_calibration_error(sure[sure > 0.5], right[sure > 0.5])),
        Figure(name="above 0.9", value=float(high.sum())),
        Figure(name="wrong above 0.9", value=float((~right[high]).mean()) if high.any() else None, target=0.05),
        Figure(name=f"above {least:g}", value=float(taken.sum())),
        Figure(name=f"wrong above {least:g}", value=float((~right[taken]).mean()) if taken.any() else None),
        Figure(name=f"of the right ones above {least:g}", value=float((right & taken).sum() / max(1, right.sum()))),
    ]


def _columns(named: Sequence[NamedAsset]) -> "tuple[Array, np.ndarray[Any, np.dtype[np.bool_]]]":
    return np.array([asset.confidence for asset in named]), np.array([asset.right for asset in named], np.bool_)


def _calibration_error(sure: Array, right: "np.ndarray[Any, np.dtype[np.bool_]]") -> float | None:
    if not len(sure):
        return None
    bins = np.minimum((sure * _BINS).astype(np.int64), _BINS - 1)
    gaps = [float(abs((sure - right)[bins == number].sum())) for number in range(_BINS)]
    return sum(gaps) / len(sure)


def reliability(named: Sequence[NamedAsset]) -> list[dict[str, float]]:
    """Reliability by tenths of confidence: mean confidence, share of right matches, number of matches."""
    sure, right = _columns(named)
    bins = np.minimum((sure * _BINS).astype(np.int64), _BINS - 1)
    return [
        {
            "confidence": round(float(sure[bins == number].mean()), 3),
            "right": round(float(right[bins == number].mean()), 3),
            "matches": int((bins == number).sum()),
        }
        for number in np.unique(bins)
    ]


def fit_coefficients(named: Sequence[NamedAsset]) -> list[float]:
    """Constant and weights of a logistic regression of "it is right" on the inputs, by Newton's method, with a ridge
    of a single observation on each weight of the standardised inputs."""
    inputs, right = np.array([asset.inputs for asset in named]), np.array([asset.right for asset in named], np.float64)
    mean, spread = inputs.mean(axis=0), inputs.std(axis=0) + 1e-9
    design = np.column_stack([np.ones(len(inputs)), (inputs - mean) / spread])
    ridge, weights = np.eye(design.shape[1]), np.zeros(design.shape[1])
    ridge[0, 0] = 1e-9
    for _ in range(50):
        likely = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (likely - right) + ridge @ weights
        weights -= np.linalg.solve((design * (likely * (1 - likely))[:, None]).T @ design + ridge, slope)
    scaled = weights[1:] / spread
    return [float(weights[0] - scaled @ mean), *scaled.tolist()]


def write_reliability_diagram(file: Path, named: Sequence[NamedAsset]) -> None:
    """Draw the share of right matches over the confidence; the area of a disc is proportional to the number of
    matches."""
    side, edge = 400, 45
    picture: Picture = np.full((side + 2 * edge, side + 2 * edge, 3), 255, np.uint8)

    def place(across: float, up: float) -> tuple[int, int]:
        return edge + round(side * across), edge + round(side * (1 - up))

    for share in np.linspace(0, 1, 6):
        cv2.line(picture, place(0, share), place(1, share), (225, 225, 225), 1)
        write_words(picture, f"{share:.1f}", (8, place(0, share)[1] + 4), 0.4)
        write_words(picture, f"{share:.1f}", (place(share, 0)[0] - 10, side + edge + 20), 0.4)
    cv2.line(picture, place(0, 0), place(1, 1), (150, 150, 150), 1, cv2.LINE_AA)
    for row in reliability(named):
        radius = max(3, round(40 * (row["matches"] / len(named)) ** 0.5))
        cv2.circle(picture, place(row["confidence"], row["right"]), radius, (66, 133, 244), -1, cv2.LINE_AA)
    write_words(picture, "share that is right, by confidence", (edge, 25), 0.5)
    write_picture(file, picture)
