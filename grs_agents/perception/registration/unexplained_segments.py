"""Pixels of a segment that its asset leaves unexplained: another object that stands in, on or against it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import SurfaceSamples, asset_surface_at_pose
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    grow_window,
    label_connected_components,
    mask_bounding_slices,
    pixels_in_mask,
)
from grs_agents.perception.picture_files import save_candidates_after_earlier
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import measured_depth_at_points, pixels_to_robot_frame
from grs_agents.perception.types import (
    Array,
    Candidate,
    CandidateRecord,
    DroppedCandidate,
    Mask,
    RGBDFrame,
    SceneObject,
    TableFrame,
)

CONFIG = DEFAULT.explanation

Picture = npt.NDArray[np.uint8]
KERNEL = np.ones((3, 3), np.uint8)


def add_residual_candidates(
    objects: Sequence[SceneObject],
    records: Sequence[CandidateRecord],
    masks: Mapping[int, Mask],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
    folder: Path,
) -> tuple[tuple[CandidateRecord, ...], tuple[DroppedCandidate, ...]]:
    """Find candidates among the pixels that the registered objects leave unexplained. Given masks are not divided.

    Args:
        objects: the objects at their registered poses.
        records: all segments so far.
        masks: the pixels (H, W) of each object, by number.
        frame: the photo.
        table: the table in it.
        library: the library that holds the assets.
        folder: the run folder; masks and crops are written there.

    Returns:
        The residual candidates, and the objects whose segments they divide.
    """
    if not objects or all(record.given for record in records):
        return (), ()
    surfaces = [
        asset_surface_at_pose(item.asset, (item.position, item.orientation), library) if item.matched else None
        for item in objects
    ]
    first = max(record.id for record in records) + 1
    residual = find_residual_candidates([masks[item.id] for item in objects], surfaces, frame, table, first)
    added = save_candidates_after_earlier(frame, residual.candidates, records, folder) if residual.candidates else ()
    reason = "much of it belongs to known things; the rest is looked at again"
    return added, tuple(DroppedCandidate(id=objects[index].id, reason=reason) for index in residual.divided)


@dataclass(frozen=True)
class ResidualCandidates:
    """Candidates among the pixels that registered assets leave unexplained."""

    candidates: tuple[Candidate, ...] = ()
    divided: tuple[int, ...] = ()  # indices of segments without an asset that joined known objects with these


def find_residual_candidates(
    masks: Sequence[Mask], surfaces: Sequence[SurfaceSamples | None], frame: RGBDFrame, table: TableFrame, first: int
) -> ResidualCandidates:
    """Measure the components of `label_residual_pixels` and number them from ``first``."""
    labels, divided = label_residual_pixels(masks, surfaces, frame, table)
    try:
        found = measure_candidates(frame, table, labels)
    except InputError:  # no component that could be an object
        return ResidualCandidates(divided=divided)
    numbered = tuple(replace(candidate, id=first + index) for index, candidate in enumerate(found))
    return ResidualCandidates(numbered, divided)


def label_residual_pixels(
    masks: Sequence[Mask], surfaces: Sequence[SurfaceSamples | None], frame: RGBDFrame, table: TableFrame
) -> tuple[Labels, tuple[int, ...]]:
    """Label the pixels of segments that assets leave unexplained.

    Args:
        masks: (H, W) of each segment.
        surfaces: the surface of its asset at its pose, robot frame; None without an asset.
        frame: the photo.
        table: the table in it.

    Returns:
        Labels (H, W), 0 elsewhere, and the indices of the segments without an asset that are divided.
    """
    known = [surface for surface in surfaces if surface is not None]
    labels, divided = np.zeros(frame.depth.shape, np.int32), list[int]()
    for index, (mask, surface) in enumerate(zip(masks, surfaces, strict=True)):
        cloud = _Cloud.from_mask(mask, frame, table)
        rest = _mask_off_assets_of_others(cloud, known) if surface is None else None
        if surface is not None:
            above_table = cloud.points[:, 2] > CONFIG.off
            off = (surface.distances_to_points(cloud.points) > CONFIG.off) & above_table
            explained = len(off) > 0 and off.mean() <= 1 - CONFIG.explained
            if explained and _is_consistent_with_depth(surface, frame, table):
                rest = cloud.draw_pixel_mask(off)
        if rest is None:
            continue
        opened = cv2.morphologyEx(rest, cv2.MORPH_OPEN, KERNEL)
        pieces = label_connected_components(opened, int(CONFIG.smallest * labels.size))
        part = labels[cloud.window]
        part[pieces > 0] = pieces[pieces > 0] + labels.max()
        divided += [index] if surface is None else []
    return labels, tuple(divided)


@dataclass(frozen=True)
class _Cloud:
    """The measured pixels of a segment in a window (h, w), and their points (N, 3), m, robot frame."""

    window: tuple[slice, slice]
    rows: Index
    columns: Index
    points: Array
    shape: tuple[int, ...]

    @classmethod
    def from_mask(cls, mask: Mask, frame: RGBDFrame, table: TableFrame) -> "_Cloud":
        window = grow_window(mask_bounding_slices(mask), 2)  # the morphological opening needs a margin
        depth = frame.depth[window]
        rows, columns = pixels_in_mask(mask[window] & (depth > 0))
        points = pixels_to_robot_frame(frame, table, rows + window[0].start, columns + window[1].start)
        return cls(window, rows, columns, points, depth.shape)

    def draw_pixel_mask(self, chosen: Mask) -> Picture:
        """Mask (h, w) of the ``chosen`` (N,) points."""
        drawn = np.zeros(self.shape, np.uint8)
        drawn[self.rows[chosen], self.columns[chosen]] = 1
        return drawn


def _is_consistent_with_depth(surface: SurfaceSamples, frame: RGBDFrame, table: TableFrame) -> bool:
    """Whether the visible side of a surface lies at the measured depth, with little of it in free space."""
    facing = ((surface.points - table.camera_position) * surface.normals).sum(axis=1) < 0
    measured, depth = measured_depth_at_points(surface.points[facing], frame, table)
    before = (measured - depth)[measured > 0]
    if not len(before):
        return False
    shown, in_free_space = (np.abs(before) < CONFIG.off).mean(), (before > CONFIG.off).mean()
    return bool(shown > CONFIG.shown and in_free_space < CONFIG.in_free_space)


def _mask_off_assets_of_others(cloud: _Cloud, surfaces: Sequence[SurfaceSamples]) -> Picture | None:
    """Mask (h, w) of the points off the surfaces of other objects; ``None`` if few points lie on these surfaces."""
    distances = np.full(len(cloud.points), np.inf)
    for surface in surfaces:
        distances = np.minimum(distances, surface.distances_within_reach(cloud.points, CONFIG.off))
    on_others = cv2.morphologyEx(cloud.draw_pixel_mask(distances < CONFIG.on), cv2.MORPH_OPEN, KERNEL)
    joined = on_others.sum() > CONFIG.joined * len(distances)  # opening removes the thin strip of a mere contact
    return cloud.draw_pixel_mask(distances > CONFIG.off) if joined else None


def match_pieces_to_objects(clouds: Sequence[Array], surfaces: Sequence[SurfaceSamples | None]) -> dict[int, int]:
    """Match segments that are pieces of known objects: their points lie on the surface of a larger segment's asset.

    Args:
        clouds: the points (N, 3) of each segment, m, robot frame.
        surfaces: the surface of its asset at its pose, robot frame; None without an asset.

    Returns:
        The index of the object for the index of each piece.
    """
    pieces: dict[int, int] = {}
    for piece, cloud in enumerate(clouds):
        for whole, surface in enumerate(surfaces):
            larger = whole != piece and len(clouds[whole]) > len(cloud) and whole not in pieces
            if surface is None or not larger or not len(cloud):
                continue
            if (surface.distances_within_reach(cloud, CONFIG.on) < CONFIG.on).mean() >= CONFIG.piece:
                pieces[piece] = whole
                break
    return pieces
