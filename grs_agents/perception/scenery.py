"""What stands on the table, or seems to, and is no object: by where it is, or by what it comes in from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.coverage import measure_coverage, raised_pixel_mask
from grs_agents.perception.image_geometry import convex_footprint_hull, points_in_hull_mask
from grs_agents.perception.segmentation import is_segment_entering_view
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Candidate, Mask, RGBDFrame, TableFrame, X, Y
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

CONFIG = DEFAULT.scenery
ROBOT = "the robot, at the joints that camera.json gives"
ENTERING = "comes in from above or from beyond the picture: an arm, a hand or a lamp"
WALL = "a wall of a bin around the other things"


@dataclass(frozen=True)
class SortedCandidates:
    """What a segmentation found, without what is no object."""

    objects: tuple[Candidate, ...]  # numbered from 1
    reasons: tuple[str, ...]  # why what was left out is no object, one for each
    left_out: Mask  # (H, W) its pixels, and those of the robot


def separate_scenery_from_objects(
    candidates: Sequence[Candidate], robot: Mask, frame: RGBDFrame, table: TableFrame
) -> SortedCandidates:
    """Sort out what lies behind the base of a calibrated robot or beyond its workspace, the walls of a bin, and what
    comes in from above or from beyond the picture, whether it was segmented or not. Like the segmentation itself, this
    works at the photo's working size.

    Args:
        candidates: the segments, robot frame.
        robot: (H, W) the pixels that are known to show the robot.
        frame: the photo.
        table: the table in it.
    """
    small, factor = downscale_frame(frame)
    points = robot_frame_point_map(small, table)
    reduced = [replace(one, mask=downscale_mask(one.mask, factor)) for one in candidates]
    why = _explain_scenery_by_number(reduced, downscale_mask(robot, factor), points, table)
    kept = [one for one in candidates if one.id not in why]
    left_out = _unite_mask_with_candidates(robot, [one for one in candidates if one.id in why])
    owned = _unite_mask_with_candidates(left_out, kept)
    reasons = [*([ROBOT] if robot.any() else []), *why.values()]
    above = raised_pixel_mask(small, table, downscale_mask(left_out, factor))
    for mask, _ in measure_coverage(small, table, above, downscale_mask(owned, factor)).regions:
        entering = is_segment_entering_view(mask, points, DEFAULT.segmentation)
        if entering or _surrounds_other_candidates(mask, kept, points):
            reasons.append(ENTERING if entering else WALL)
            left_out |= repeat_cells(mask, frame, factor) & ~owned
    numbered = tuple(replace(one, id=number) for number, one in enumerate(kept, 1))
    return SortedCandidates(numbered, tuple(dict.fromkeys(reasons)), left_out)


def _explain_scenery_by_number(
    candidates: Sequence[Candidate], robot: Mask, points: Array, table: TableFrame
) -> dict[int, str]:
    """Why segments, by number, are no objects; those that may be objects, or were given as such, are not in it."""
    candidates = _drop_given_candidates(candidates)
    beside_robot = _dilate_mask(robot, CONFIG.meets)
    why = {one.id: _explain_scenery_by_position(one, candidates, points, table) for one in candidates}
    why |= {one.id: ROBOT for one in candidates if _is_blurred_robot_edge(one.mask, beside_robot)}
    known = _unite_mask_with_candidates(robot, [one for one in candidates if why[one.id]])
    walls = _find_straight_walls([one for one in candidates if not why[one.id]], known, points)
    why |= {one.id: WALL for one in walls}
    return {number: reason for number, reason in why.items() if reason}


def _unite_mask_with_candidates(mask: Mask, candidates: Sequence[Candidate]) -> Mask:
    united = mask.copy()
    for one in candidates:
        united |= one.mask
    return united


def _drop_given_candidates(candidates: Sequence[Candidate]) -> list[Candidate]:
    return [one for one in candidates if not one.given]


def _dilate_mask(mask: Mask, pixels: int) -> Mask:
    """A mask (H, W) with what is at most so many pixels away."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * pixels + 1,) * 2, np.uint8)), np.bool_)


def _is_blurred_robot_edge(mask: Mask, beside_robot: Mask) -> bool:
    """Whether a segment (H, W) is nowhere wider than the robot's blurred edge, and lies beside the robot."""
    core = cv2.erode(mask.astype(np.uint8), np.ones((CONFIG.meets + 1,) * 2, np.uint8))
    beside = np.count_nonzero(beside_robot & mask) > CONFIG.beside * np.count_nonzero(mask)
    return bool(beside and not core.any())


def _explain_scenery_by_position(
    candidate: Candidate, candidates: Sequence[Candidate], points: Array, table: TableFrame
) -> str:
    """Why one of the segments is no object, by where it is; empty if it may be one."""
    if is_segment_entering_view(candidate.mask, points, DEFAULT.segmentation):
        return ENTERING
    if _surrounds_other_candidates(candidate.mask, [other for other in candidates if other is not candidate], points):
        return WALL
    if table.origin != "calibrated":
        return ""
    x, y, _ = candidate.box.center
    if x < CONFIG.base:
        return f"behind the robot's base, at x = {x:.2f}, y = {y:.2f} m"
    if x > X[1] + CONFIG.beyond or not Y[0] - CONFIG.beyond <= y <= Y[1] + CONFIG.beyond:
        return f"beyond the workspace, at x = {x:.2f}, y = {y:.2f} m"
    return ""


def _surrounds_other_candidates(mask: Mask, others: Sequence[Candidate], points: Array) -> bool:
    """Whether a segment (H, W) stands all around most of the ``others``, which begin deep below its rim."""
    cloud = points[mask][:: CONFIG.thinned]
    cloud = cloud[np.isfinite(cloud[:, 2]) & (cloud[:, 2] > CONFIG.raised)]
    if len(cloud) < CONFIG.fewest:
        return False
    low, high = np.percentile(cloud, (1, 99), axis=0)
    hull = convex_footprint_hull(cloud[((cloud >= low) & (cloud <= high)).all(axis=1)])
    deep = [other.box.center[:2] for other in others if other.box.low[2] < high[2] / 2]
    cells = np.unique(np.floor(cloud[:, :2] / CONFIG.raised), axis=0)
    long, short = np.sort((high - low)[:2])[::-1]
    if (
        long > CONFIG.corners[0]
        and short > CONFIG.corners[1]
        and len(cells) * CONFIG.raised**2 < CONFIG.empty * long * short
    ):
        return len(deep) > 1
    inside = np.count_nonzero(points_in_hull_mask(np.array(deep).reshape(-1, 2), hull, 0.0))
    if inside < max(CONFIG.enclosed, len(others) / 2) or max(high[:2] - low[:2]) < CONFIG.bin:
        return False
    x, y = (cloud[:, :2] - (low[:2] + high[:2]) / 2).T
    sectors = np.unique(np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * CONFIG.sectors))
    return bool(len(sectors) >= CONFIG.around * CONFIG.sectors)


def _find_straight_walls(candidates: Sequence[Candidate], left_out: Mask, points: Array) -> list[Candidate]:
    """The walls of a bin that is seen in part: long and thin segments with all others to one side, of which both ends
    meet another one, what was ``left_out`` (H, W), or the picture's border."""
    ends = {one.id: _end_pixel_masks(one, points) for one in candidates if _is_straight_wall(one, candidates)}
    found: list[Candidate] = []
    edge = left_out.copy()
    edge[[0, -1]] = edge[:, [0, -1]] = True
    long = [one for one in candidates if one.id in ends]
    for one in long:
        meets = np.logical_or.reduce([edge, *(other.mask for other in long if other is not one)])
        near = _dilate_mask(meets, CONFIG.meets)
        if all((near & end).any() for end in ends[one.id]):
            found.append(one)
    return found


def _is_straight_wall(candidate: Candidate, candidates: Sequence[Candidate]) -> bool:
    """Whether a segment is long, thin and higher than it is thick, with all others on one side of it."""
    length, width, height = candidate.upright.size
    yaw = candidate.upright.yaw + (0 if length > width else np.pi / 2)
    across = np.array([-np.sin(yaw), np.cos(yaw)])
    sides = [float(across @ np.subtract(one.box.center[:2], candidate.upright.center[:2])) for one in candidates]
    one_sided = min(sides) > -CONFIG.thickest or max(sides) < CONFIG.thickest
    return (
        max(length, width) > CONFIG.long
        and min(length, width) < CONFIG.thickest
        and height > CONFIG.raised
        and one_sided
    )


def _end_pixel_masks(candidate: Candidate, points: Array) -> tuple[Mask, Mask]:
    """(H, W) the pixels of either end of a long segment."""
    length, width, _ = candidate.upright.size
    yaw = candidate.upright.yaw + (0 if length > width else np.pi / 2)
    along = points[..., :2] @ np.array([np.cos(yaw), np.sin(yaw)])
    low, high = np.nanpercentile(along[candidate.mask], (CONFIG.end, 100 - CONFIG.end))
    return candidate.mask & (along <= low), candidate.mask & (along >= high)
