"""Where the assets of a measured scene stand, and its twin: what the agents would match is taken from the truth."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from evals.benchmark.ground_truth import LabelledScene
from evals.benchmark.segmentation_metrics import overlaps
from grs_agents.library import Library
from grs_agents.perception import (
    Candidate,
    EstimatedVolume,
    Mask,
    Registered,
    ResidualCandidates,
    RGBDFrame,
    Surroundings,
    TableFrame,
    TwinReport,
    asset_surface_at_pose,
    find_residual_candidates,
    register_asset,
)
from grs_agents.perception.proxies import choose_proxy_kind, measure_shape, write_proxy
from grs_agents.perception.settling import (
    KnownObject,
    Placed,
    PlacedObject,
    Reconciled,
    RestState,
    Segment,
    match_fallen_to_support,
    reconcile_segments,
    repair_collisions,
    settle_and_report,
)


@dataclass(frozen=True)
class TwinRun:
    """What stands for the candidates, by their numbers.

    Attributes:
        poses: of the assets of candidates that match an object of the library.
        placed: where they come to rest in the twin.
        twin: its figures; ``None`` where nothing stands on the simulated table.
    """

    poses: Mapping[int, Registered] = field(default_factory=dict[int, Registered])
    placed: Mapping[int, Placed] = field(default_factory=dict[int, Placed])
    twin: TwinReport | None = None


def settle_true_assets(
    scene: LabelledScene,
    found: npt.NDArray[np.int32],
    candidates: Sequence[Candidate],
    library: Library,
    table: TableFrame | None,
) -> TwinRun:
    """Register the true asset of each candidate that matches an object, let proxies stand for the others, and settle.

    As in a run, what the assets do not explain of their segments is matched in its turn, and pieces of things whose
    assets are known have no proxy of their own.

    Args:
        scene: with its truth; without true assets there is nothing to say.
        found: (H, W) numbers of the candidates.
        candidates: measured in ``table``'s frame.
        library: where the true assets are looked up.
        table: ``None`` where none was found.

    Raises:
        SimulationError: MuJoCo takes the twin for impossible.
    """
    truth = {one.id: one.asset for one in scene.truth.objects if one.asset in library}
    if table is None or not truth or not candidates:
        return TwinRun()
    poses: dict[int, Registered] = {}
    where = (scene.frame, table, library)
    segments = _segments(candidates, _assets(scene, found, truth), poses, where)
    residual = _residual(segments, scene, library, table, 1 + max(one.id for one in candidates))
    kept = [index for index in range(len(candidates)) if index not in residual.divided]
    missed = _missed(scene, found, truth)
    segments = [segments[index] for index in kept]
    segments += _segments(residual.candidates, _assets(scene, _painted(residual, found), missed), poses, where)
    every = [*(candidates[index] for index in kept), *residual.candidates]
    return _settled(
        every, _without_collisions(every, segments, poses, scene, library, table), poses, scene, library, table
    )


def _residual(
    segments: Sequence[Segment], scene: LabelledScene, library: Library, table: TableFrame, first: int
) -> ResidualCandidates:
    """What the registered assets do not explain of their segments, numbered from ``first``."""
    known = [one.known for one in segments]
    surfaces = [None if one is None else asset_surface_at_pose(one.asset, one.pose, library) for one in known]
    return find_residual_candidates([one.mask for one in segments], surfaces, scene.frame, table, first)


def _painted(residual: ResidualCandidates, found: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The residual candidates as a picture of their numbers, (H, W)."""
    labels = np.zeros_like(found)
    for one in residual.candidates:
        labels[one.mask] = one.id
    return labels


def _missed(scene: LabelledScene, found: npt.NDArray[np.int32], truth: Mapping[int, str]) -> dict[int, str]:
    """The true assets, by label, of the objects that no segment matches."""
    matched = set(overlaps(found, scene.labels, scene.ignored()).matched().values())
    return {label: asset for label, asset in truth.items() if label not in matched}


def _assets(scene: LabelledScene, found: npt.NDArray[np.int32], truth: Mapping[int, str]) -> dict[int, str]:
    """The true assets, given by label, of the segments that match an object of which it is known, by their numbers."""
    return {
        number: truth[label]
        for number, label in overlaps(found, scene.labels, scene.ignored()).matched().items()
        if label in truth
    }


def _segments(
    candidates: Sequence[Candidate],
    assets: Mapping[int, str],
    poses: dict[int, Registered],
    where: tuple[RGBDFrame, TableFrame, Library],
) -> list[Segment]:
    """The candidates with their assets, registered; ``poses`` takes where those stand."""
    frame, table, library = where
    segments: list[Segment] = []
    for one in candidates:
        thing = None
        if one.id in assets:
            stood = poses[one.id] = register_asset(assets[one.id], library, one.upright, frame, table, one.mask)
            thing = PlacedObject(assets[one.id], (stood.position, stood.orientation))
        segments.append(Segment(one.mask, one.upright, one.shape, thing, one.hollow))
    return segments


def _without_collisions(
    candidates: Sequence[Candidate],
    segments: Sequence[Segment],
    poses: dict[int, Registered],
    scene: LabelledScene,
    library: Library,
    table: TableFrame,
) -> list[Segment]:
    """The segments with their assets beside, not in each other; ``poses`` takes where those stand."""
    pairs = zip(candidates, segments, strict=True)
    known = {
        one.id: KnownObject(segment.known, segment.box, segment.mask)
        for one, segment in pairs
        if segment.known is not None
    }
    apart = repair_collisions(list(known.values()), scene.frame, table, library)
    numbers = list(known)
    poses.update({numbers[index]: found for index, found in apart.moved.items()})
    for index in apart.wrong:
        del poses[numbers[index]]
    found: list[Segment] = []
    for one, segment in zip(candidates, segments, strict=True):
        stood, thing = poses.get(one.id), segment.known
        here = (
            None if thing is None or stood is None else PlacedObject(thing.asset, (stood.position, stood.orientation))
        )
        found.append(replace(segment, known=here))
    return found


def _settled(
    candidates: Sequence[Candidate],
    segments: Sequence[Segment],
    poses: Mapping[int, Registered],
    scene: LabelledScene,
    library: Library,
    table: TableFrame,
) -> TwinRun:
    """The twin of segments and what stands for them."""
    rest, twin, agreed, kept = _at_rest(candidates, segments, {}, scene, library, table)
    fell = {index for index, one in zip(kept, rest.placed, strict=True) if one is not None and one.fell}
    if carried := match_fallen_to_support(fell, agreed):
        rest, twin, agreed, kept = _at_rest(candidates, segments, carried, scene, library, table)
    placed = {candidates[index].id: one for index, one in zip(kept, rest.placed, strict=True) if one is not None}
    return TwinRun(poses, placed, twin if placed else None)


def _at_rest(
    candidates: Sequence[Candidate],
    segments: Sequence[Segment],
    united: Mapping[int, int],
    scene: LabelledScene,
    library: Library,
    table: TableFrame,
) -> tuple[RestState, TwinReport, Reconciled, list[int]]:
    """Segments at rest, what became of them, and which are no pieces, by index; ``united`` are pieces of others."""
    agreed = reconcile_segments(segments, scene.frame, table, library, united)
    kept = [index for index in range(len(segments)) if index not in agreed.pieces]
    with tempfile.TemporaryDirectory(prefix="grs-twin-") as folder:
        where = Path(folder)
        proxies = {
            index: _proxy(
                candidates[index],
                agreed.masks[index],
                claim,
                agreed.surroundings_of_segment(index),
                scene,
                table,
                where,
            )
            for index, claim in agreed.claims.items()
        }
        things = [segments[index].known or proxies[index] for index in kept]
        both = library.with_overlay(Path(folder)) if proxies else library
        rest, twin = settle_and_report(things, both, scene.frame, table, scene.labels > 0)
    return rest, twin, agreed, kept


def _proxy(
    one: Candidate,
    mask: Mask,
    claim: EstimatedVolume,
    around: Surroundings,
    scene: LabelledScene,
    table: TableFrame,
    folder: Path,
) -> PlacedObject:
    """What a run would let stand for a thing of no asset: the solid that fits its points best."""
    box = claim.box
    measured = measure_shape(scene.frame, table, mask, box, around)
    kind = choose_proxy_kind(measured, box.size, claim.shape == "cylinder", one.hollow)
    asset = write_proxy(folder, f"candidate_{one.id}", kind, box.size, one.color, "a proxy", measured)
    return PlacedObject(
        asset.name, (box.center, (0.0, 0.0, float(np.sin(box.yaw / 2)), float(np.cos(box.yaw / 2)))), guessed=True
    )
