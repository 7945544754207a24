"""Objects on the table: segments by a tool, without robot, arms, and surroundings of the workspace."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.coverage import measure_coverage, raised_pixel_mask
from grs_agents.perception.image_geometry import compute_percentiles
from grs_agents.perception.plane_fitting import Plane, depth_tolerance, find_planes
from grs_agents.perception.segmentation.candidates import shift_to_workspace
from grs_agents.perception.segmentation.color_borders import fit_masks_to_color
from grs_agents.perception.segmentation.segmentation import find_view_border, is_segment_entering_view
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Candidate, Mask, RGBDFrame, TableFrame, X, Y
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

CONFIG = DEFAULT.scenery
ROBOT = "the robot, at the joints that camera.json gives"
ENTERING = "comes in from above or from beyond the picture: an arm, a hand or a lamp"
SURROUNDINGS = "a wall or furniture: flat, larger than an object, and cut by the picture's border"


@dataclass(frozen=True)
class SortedCandidates:
    """Objects of a segmentation, and the rest."""

    objects: tuple[Candidate, ...]  # numbered from 1
    reasons: tuple[str, ...]  # of the segments left out, each once
    left_out: Mask  # (H, W) their pixels, and those of the robot


@dataclass(frozen=True)
class FoundObjects(SortedCandidates):
    """The objects with their borders, and the rest."""

    blur: Mask  # (H, W) pixels at an object's border that have its depth, but not its colour


def find_objects(
    frame: RGBDFrame, table: TableFrame, robot: Mask, segment: Callable[[RGBDFrame], Sequence[Candidate]]
) -> FoundObjects:
    """Find the objects on the table, with borders at colour edges.

    Args:
        frame: the photo.
        table: the table in it.
        robot: (H, W) pixels known to show the robot.
        segment: a segment tool; its frame lacks the depth of the robot.
    """
    seen = replace(frame, depth=np.where(robot, np.float32(0), frame.depth)) if robot.any() else frame
    found = separate_scenery_from_objects(segment(seen), robot, frame, table)
    objects = fit_masks_to_color(found.objects, frame, found.left_out)
    nothing = np.zeros_like(robot)
    blur = unite_mask_with_candidates(nothing, found.objects) & ~unite_mask_with_candidates(nothing, objects)
    return FoundObjects(objects, found.reasons, found.left_out, blur)


def separate_scenery_from_objects(
    candidates: Sequence[Candidate], robot: Mask, frame: RGBDFrame, table: TableFrame
) -> SortedCandidates:
    """Separate objects from surroundings, at the photo's working size.

    No objects are the robot, segments or unsegmented regions behind the base of a calibrated robot, beyond its
    workspace or beyond the simulated table, those that enter from above or from beyond the picture, and walls and
    furniture behind the objects.

    Args:
        candidates: the segments, robot frame.
        robot: (H, W) pixels known to show the robot.
        frame: the photo.
        table: the table in it.
    """
    small, factor = downscale_frame(frame)
    points = robot_frame_point_map(small, table)
    reduced = [replace(item, mask=downscale_mask(item.mask, factor)) for item in candidates if not item.given]
    small_robot = downscale_mask(robot, factor)
    owned = unite_mask_with_candidates(np.zeros_like(small_robot), reduced)
    shift, borders = shift_to_workspace(table, candidates), find_view_border(points)
    why: dict[int, str] = {}
    for item in reduced:
        x, y, _ = item.box.center + shift
        if is_segment_entering_view(item.mask, points, borders, small.camera, DEFAULT.segmentation):
            why[item.id] = ENTERING
        elif place := _explain_place(float(x), float(y), table):
            why[item.id] = place
    if small_robot.any():
        distance = np.asarray(cv2.distanceTransform((~small_robot).astype(np.uint8), cv2.DIST_L2, 5), np.float64)
        why |= {item.id: ROBOT for item in reduced if _is_robot(item.mask, distance, points[..., 2], owned)}
    why = {item.id: why[item.id] for item in reduced if item.id in why}  # in the order of the segments
    left_out = unite_mask_with_candidates(robot, [item for item in candidates if item.id in why])
    owned = unite_mask_with_candidates(left_out, [item for item in candidates if item.id not in why])
    reasons = [*([ROBOT] if robot.any() else []), *why.values()]
    above = raised_pixel_mask(small, table, downscale_mask(left_out, factor))
    surfaces: list[Plane] = []
    for mask, region in measure_coverage(small, table, above, downscale_mask(owned, factor)).regions:
        behind = _fit_surroundings(mask, small, points) if (mask & (borders[0] | borders[1])).any() else []
        x, y, _ = region.box.center + shift
        entering = is_segment_entering_view(mask, points, borders, frame.camera, DEFAULT.segmentation)
        reason = ENTERING if entering else SURROUNDINGS if behind else _explain_place(float(x), float(y), table)
        if reason:
            reasons.append(reason)
            left_out |= repeat_cells(mask, frame, factor) & ~owned
            surfaces += behind
    pieces = [item for item in reduced if item.id not in why and any(_lies_on(item.mask, small, it) for it in surfaces)]
    why |= {item.id: SURROUNDINGS for item in pieces}
    reasons += [SURROUNDINGS] * len(pieces)
    left_out = unite_mask_with_candidates(left_out, [item for item in candidates if item.id in why])
    kept = [item for item in candidates if item.id not in why]
    numbered = tuple(replace(item, id=number) for number, item in enumerate(kept, 1))
    return SortedCandidates(numbered, tuple(dict.fromkeys(reasons)), left_out)


def _explain_place(x: float, y: float, table: TableFrame) -> str:
    """Reason that a place in the workspace's frame, m, is none of an object; empty if it may be."""
    place = f"at x = {x:.2f}, y = {y:.2f} m"
    if table.origin == "calibrated":
        if x < CONFIG.base:
            return f"behind the robot's base, {place}"
        if x > X[1] + CONFIG.beyond or not Y[0] - CONFIG.beyond <= y <= Y[1] + CONFIG.beyond:
            return f"beyond the workspace, {place}"
    middle, reach = DEFAULT.settling.table_center, DEFAULT.settling.table_reach
    return f"beyond the simulated table, {place}" if np.hypot(x - middle[0], y - middle[1]) > reach else ""


def _fit_surroundings(region: Mask, frame: RGBDFrame, points: Array) -> list[Plane]:
    """The flat surface that a region (H, W) mostly shows, if it is larger than an object.

    ``points`` are (H, W, 3) in the robot frame."""
    cloud = points[region & (frame.depth > 0)]
    if len(cloud) < DEFAULT.segmentation.filter.fewest:
        return []
    low, high = compute_percentiles(cloud, (1, 99))
    if (high - low).max() <= DEFAULT.measuring.largest:
        return []
    seen = frame.camera_frame_point_map()[region & (frame.depth > 0)]
    planes = find_planes(seen[:: len(seen) // CONFIG.samples + 1], np.random.default_rng(0))
    return [plane for plane in planes if plane.share > CONFIG.flat]


def _lies_on(segment: Mask, frame: RGBDFrame, plane: Plane) -> bool:
    """Whether a segment (H, W) is a piece of a flat surface: a poster, or a patch of a wall."""
    seen = frame.camera_frame_point_map()[segment & (frame.depth > 0)]
    near = np.abs(plane.heights_of_points(seen)) < 2 * depth_tolerance(seen[:, 2])
    return bool(np.count_nonzero(near) > CONFIG.mostly * len(near))


def unite_mask_with_candidates(mask: Mask, candidates: Sequence[Candidate]) -> Mask:
    """(H, W) union of the ``mask`` (H, W) and those of the candidates."""
    united = mask.copy()
    for candidate in candidates:
        united |= candidate.mask
    return united


def _is_robot(segment: Mask, distance: Array, height: Array, owned: Mask) -> bool:
    """Whether a segment (H, W) is a hole in the robot's depth that smoothing filled, or its blurred edge.

    Args:
        distance: (H, W) of each pixel from the robot, pixels.
        height: (H, W) m.
        owned: (H, W) pixels of all segments.
    """
    near = distance[segment]
    hole = np.count_nonzero(near <= 0) > CONFIG.robot * len(near)
    # Thin parts of an arm mix with the background and are measured off the model.
    if hole or np.count_nonzero(near < CONFIG.thin) > CONFIG.mostly * len(near):
        return True
    if not len(near):  # a speck of a large photo
        return False
    # A blurred edge is a strip along the robot that falls off towards the table.
    width = float(np.percentile(near, 98))
    if near.min() >= CONFIG.meets or width >= CONFIG.widest:
        return False
    heights = height[segment]
    parts = (heights[near < width / 3], heights, heights[near > width * 2 / 3])
    inner, middle, outer = (float(np.nanmedian(part)) if np.isfinite(part).any() else 0.0 for part in parts)
    if middle >= CONFIG.low or outer >= CONFIG.fades or inner - outer <= CONFIG.falls:
        return False
    # It borders on table and hardly on other segments, or it is part of an object, as the side of a bowl is.
    around = np.ones((2 * CONFIG.ring + 1,) * 2, np.uint8)
    ring = (cv2.dilate(segment.astype(np.uint8), around) > 0) & ~segment
    count = np.count_nonzero(ring)
    if np.count_nonzero(ring & owned) >= CONFIG.segments * count:
        return False
    return bool(np.count_nonzero(ring & ~owned & (height < CONFIG.table)) > CONFIG.borders * count)
