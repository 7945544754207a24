"""What of a segment its asset does not explain: another object that stands in, on or against it in the photo."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.perception.asset_surfaces import Surface
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    grow_window,
    label_connected_components,
    mask_bounding_slices,
    pixels_in_mask,
)
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import measured_depth_at_points, pixels_to_robot_frame
from grs_agents.perception.types import Array, Candidate, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.explanation

Picture = npt.NDArray[np.uint8]
KERNEL = np.ones((3, 3), np.uint8)


def _is_consistent_with_depth(surface: Surface, frame: RGBDFrame, table: TableFrame) -> bool:
    """Whether an asset is the right one, as far as can be seen: its surface is where the photo shows one."""
    facing = ((surface.points - np.asarray(table.T_robot_cam)[:3, 3]) * surface.normals).sum(axis=1) < 0
    measured, depth = measured_depth_at_points(surface.points[facing], frame, table)
    before = (measured - depth)[measured > 0]
    if not len(before):
        return False
    shown, in_free_space = (np.abs(before) < CONFIG.off).mean(), (before > CONFIG.off).mean()
    return bool(shown > CONFIG.shown and in_free_space < CONFIG.in_free_space)


@dataclass(frozen=True)
class ResidualCandidates:
    """What is found once assets stand."""

    candidates: tuple[Candidate, ...] = ()  # so far they were taken for parts of other objects
    # segments without an asset, by index, that are these and parts of objects whose assets are known
    divided: tuple[int, ...] = ()


def find_residual_candidates(
    masks: Sequence[Mask], surfaces: Sequence[Surface | None], frame: RGBDFrame, table: TableFrame, first: int
) -> ResidualCandidates:
    """What `label_residual_pixels` finds, measured and numbered from ``first``."""
    labels, divided = label_residual_pixels(masks, surfaces, frame, table)
    try:
        found = measure_candidates(frame, table, labels)
    except InputError:  # nothing, or nothing that could be an object
        return ResidualCandidates(divided=divided)
    return ResidualCandidates(tuple(replace(one, id=first + index) for index, one in enumerate(found)), divided)


def label_residual_pixels(
    masks: Sequence[Mask], surfaces: Sequence[Surface | None], frame: RGBDFrame, table: TableFrame
) -> tuple[Labels, tuple[int, ...]]:
    """(H, W) labels from 1 of what segments leave over once their assets stand, 0 elsewhere; and which it divides."""
    known = [surface for surface in surfaces if surface is not None]
    labels, divided = np.zeros(frame.depth.shape, np.int32), list[int]()
    for index, (mask, surface) in enumerate(zip(masks, surfaces, strict=True)):
        cloud = _Cloud.from_mask(mask, frame, table)
        rest = (
            _mask_off_other_surfaces(cloud, known)
            if surface is None
            else _mask_off_own_surface(cloud, surface, frame, table)
        )
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
    """The pixels of a segment in a window (h, w) around it, and their measured (N, 3) points, m, robot frame."""

    window: tuple[slice, slice]
    rows: Index
    columns: Index
    points: Array
    shape: tuple[int, ...]

    @classmethod
    def from_mask(cls, mask: Mask, frame: RGBDFrame, table: TableFrame) -> "_Cloud":
        window = grow_window(mask_bounding_slices(mask), 2)  # so that opening sees what is around the segment
        depth = frame.depth[window]
        rows, columns = pixels_in_mask(mask[window] & (depth > 0))
        points = pixels_to_robot_frame(frame, table, rows + window[0].start, columns + window[1].start)
        return cls(window, rows, columns, points, depth.shape)

    def draw_pixel_mask(self, chosen: Mask) -> Picture:
        """(h, w) where those are of which ``chosen`` (N,) is true."""
        drawn = np.zeros(self.shape, np.uint8)
        drawn[self.rows[chosen], self.columns[chosen]] = 1
        return drawn


def _mask_off_own_surface(cloud: _Cloud, surface: Surface, frame: RGBDFrame, table: TableFrame) -> Picture | None:
    """(h, w) what of a segment is not on the surface of its asset; ``None`` where that says nothing."""
    off = (surface.distances_to_points(cloud.points) > CONFIG.off) & (
        cloud.points[:, 2] > CONFIG.off
    )  # the table is no object
    if not len(off) or off.mean() > 1 - CONFIG.explained or not _is_consistent_with_depth(surface, frame, table):
        return None
    return cloud.draw_pixel_mask(off)


def _mask_off_other_surfaces(cloud: _Cloud, surfaces: Sequence[Surface]) -> Picture | None:
    """(h, w) what of a segment is not on the surfaces of other objects; ``None`` where little of it is."""
    near = np.full(len(cloud.points), np.inf)
    for surface in surfaces:
        near = np.minimum(near, surface.distances_within_reach(cloud.points, CONFIG.off))
    theirs = cv2.morphologyEx(
        cloud.draw_pixel_mask(near < CONFIG.on), cv2.MORPH_OPEN, KERNEL
    )  # a thin strip touches them
    return cloud.draw_pixel_mask(near > CONFIG.off) if theirs.sum() > CONFIG.joined * len(near) else None


def match_pieces_to_objects(clouds: Sequence[Array], surfaces: Sequence[Surface | None]) -> dict[int, int]:
    """Which objects are pieces of which, by index: their (N, 3) points (m, robot frame) are on that one's surface."""
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
