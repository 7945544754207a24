"""What stands on the table, or seems to, and is no object: by where it is, or by what it comes in from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.bin_walls.seen_walls import SeenWalls
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.coverage import measure_coverage, raised_pixel_mask
from grs_agents.perception.segmentation.segmentation import is_segment_entering_view
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Camera, Candidate, Mask, RGBDFrame, TableFrame, X, Y
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

CONFIG = DEFAULT.scenery
ROBOT = "the robot, at the joints that camera.json gives"
ENTERING = "comes in from above or from beyond the picture: an arm, a hand or a lamp"
WALL = "the walls of a bin around the things"


@dataclass(frozen=True)
class SortedCandidates:
    """What a segmentation found, without what is no object."""

    objects: tuple[Candidate, ...]  # numbered from 1
    reasons: tuple[str, ...]  # why what was left out is no object, one for each
    left_out: Mask  # (H, W) its pixels, and those of the robot


def separate_scenery_from_objects(
    candidates: Sequence[Candidate], robot: Mask, walls: SeenWalls, frame: RGBDFrame, table: TableFrame
) -> SortedCandidates:
    """Sort out what lies behind the base of a calibrated robot or beyond its workspace, the walls of a bin, and what
    comes in from above or from beyond the picture, whether it was segmented or not. Like the segmentation itself, this
    works at the photo's working size.

    Args:
        candidates: the segments, robot frame.
        robot: (H, W) the pixels that are known to show the robot.
        walls: where the walls of a bin are seen.
        frame: the photo.
        table: the table in it.
    """
    small, factor = downscale_frame(frame)
    points = robot_frame_point_map(small, table)
    known = robot | walls.pixels
    reduced = [replace(one, mask=downscale_mask(one.mask, factor)) for one in candidates]
    seen = replace(walls, pixels=downscale_mask(walls.pixels, factor), mixed=downscale_mask(walls.mixed, factor))
    why = _explain_scenery_by_number(reduced, downscale_mask(robot, factor), seen, points, small.camera, table)
    kept = [one for one in candidates if one.id not in why]
    left_out = unite_mask_with_candidates(known, [one for one in candidates if one.id in why])
    owned = unite_mask_with_candidates(left_out, kept)
    reasons = [*([ROBOT] if robot.any() else []), *([WALL] if walls.pixels.any() else []), *why.values()]
    above = raised_pixel_mask(small, table, downscale_mask(left_out, factor))
    for mask, _ in measure_coverage(small, table, above, downscale_mask(owned, factor)).regions:
        if is_segment_entering_view(mask, points, frame.camera, DEFAULT.segmentation):
            reasons.append(ENTERING)
            left_out |= repeat_cells(mask, frame, factor) & ~owned
    numbered = tuple(replace(one, id=number) for number, one in enumerate(kept, 1))
    return SortedCandidates(numbered, tuple(dict.fromkeys(reasons)), left_out)


def _explain_scenery_by_number(
    candidates: Sequence[Candidate], robot: Mask, walls: SeenWalls, points: Array, camera: Camera, table: TableFrame
) -> dict[int, str]:
    """Why segments, by number, are no objects; those that may be objects, or were given as such, are not in it."""
    candidates = [one for one in candidates if not one.given]
    away = np.asarray(cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5), np.float64)
    why = {one.id: _explain_scenery_by_position(one, points, camera, table) for one in candidates}
    owned = unite_mask_with_candidates(np.zeros_like(robot), candidates)
    if robot.any():
        why |= {one.id: ROBOT for one in candidates if _is_robot(one.mask, away, points[..., 2], owned)}
    why |= {one.id: WALL for one in candidates if _is_wall(one.mask, walls, points, owned)}
    return {number: reason for number, reason in why.items() if reason}


def unite_mask_with_candidates(mask: Mask, candidates: Sequence[Candidate]) -> Mask:
    """(H, W) the ``mask`` (H, W) and those of the candidates."""
    united = mask.copy()
    for one in candidates:
        united |= one.mask
    return united


def _is_robot(segment: Mask, away: Array, height: Array, owned: Mask) -> bool:
    """Whether a segment (H, W) is a hole in the robot's depth that smoothing filled, or its blurred edge; ``away``
    (H, W) says how many pixels each one is away from the robot, ``height`` (H, W) how high it is, m, and ``owned``
    (H, W) whether it is a segment's."""
    near = away[segment]
    if np.count_nonzero(near < CONFIG.thin) > CONFIG.mostly * len(near):
        return True  # an arm's thin parts mix with what is behind them: they may be measured so far from the model
    if np.count_nonzero(near <= 0) > CONFIG.robot * len(near):
        return True
    return _is_blurred_edge(near, height[segment]) and _is_beside_table(segment, height, owned)


def _is_beside_table(segment: Mask, height: Array, owned: Mask) -> bool:
    """Whether there is table beside a segment, and hardly another one: what fades into an object, as the side of a bowl
    into its bottom, is a part of it. Arguments as in `_is_robot`."""
    around = np.ones((2 * CONFIG.ring + 1,) * 2, np.uint8)
    ring = (cv2.dilate(segment.astype(np.uint8), around) > 0) & ~segment
    others, table = (np.count_nonzero(pixels) for pixels in (ring & owned, ring & ~owned & (height < CONFIG.table)))
    count = np.count_nonzero(ring)
    return bool(others < CONFIG.segments * count and table > CONFIG.borders * count)


def _is_blurred_edge(away: Array, heights: Array) -> bool:
    """Whether a segment is a strip along the robot that fades into the table, as its blurred edge does. ``away`` (N,)
    says how many pixels each of its pixels is away from the robot, ``heights`` (N,) how high it is, m."""
    if not len(away):  # a speck of a large photo
        return False
    width = float(np.percentile(away, 98))
    if away.min() >= CONFIG.meets or width >= CONFIG.widest:
        return False
    parts = (heights[away < width / 3], heights, heights[away > width * 2 / 3])
    near, middle, far = (float(np.nanmedian(part)) if np.isfinite(part).any() else 0.0 for part in parts)
    return middle < CONFIG.low and far < CONFIG.fades and near - far > CONFIG.falls


def _is_wall(segment: Mask, walls: SeenWalls, points: Array, owned: Mask) -> bool:
    """Whether a segment (H, W) mixes robot and wall, or is the rim of a wall; ``owned`` (H, W) are all segments."""
    if _mixes_robot_and_wall(walls.mixed[segment], points[segment, 2]):
        return True
    return walls.has_as_rim(points[segment], points[owned & ~segment])


def _mixes_robot_and_wall(mixed: Mask, heights: Array) -> bool:
    """Whether a segment is made of depth that mixes the robot with a wall; ``mixed`` (N,) says which of its pixels may
    be, ``heights`` (N,) how high they are, m."""
    known = np.isfinite(heights)
    if mixed[known].sum() <= CONFIG.mixed * known.sum() or not known.any():
        return False
    middle, top = np.percentile(heights[known], (50, 98))
    return bool(top - middle > CONFIG.level)


def _explain_scenery_by_position(candidate: Candidate, points: Array, camera: Camera, table: TableFrame) -> str:
    """Why a segment is no object, by where it is; empty if it may be one."""
    if is_segment_entering_view(candidate.mask, points, camera, DEFAULT.segmentation):
        return ENTERING
    if table.origin != "calibrated":
        return ""
    x, y, _ = candidate.box.center
    if x < CONFIG.base:
        return f"behind the robot's base, at x = {x:.2f}, y = {y:.2f} m"
    if x > X[1] + CONFIG.beyond or not Y[0] - CONFIG.beyond <= y <= Y[1] + CONFIG.beyond:
        return f"beyond the workspace, at x = {x:.2f}, y = {y:.2f} m"
    return ""
