"""Candidates from labels: boxes, colours, shapes and crops of the segments; placement of the robot frame."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion, to_vec3
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    THINNEST,
    Labels,
    axes_from_yaws,
    compute_percentiles,
    convex_footprint_hull,
    fit_smallest_rectangle,
    mask_bounding_slices,
    pixels_by_label,
    points_in_box_mask,
    points_in_hull_mask,
    values_in_mask,
)
from grs_agents.perception.segmentation.footprints import (
    compute_view_frame,
    fit_bowl_rim,
    fit_elliptic_footprint,
    is_open_at_top,
)
from grs_agents.perception.table_finding import describe_table_doubts, matrix_to_tuples, pixels_to_robot_frame
from grs_agents.perception.types import (
    SEEN_TOO_SPARSELY,
    Aabb,
    Array,
    Candidate,
    Mask,
    RGBDFrame,
    Solid,
    TableFrame,
    UprightBox,
    is_reachable_position,
)

CONFIG = DEFAULT.measuring

DIMMED = (np.arange(256) * 0.35).astype(np.uint8)  # lookup table of brightness outside of a segment


def measure_candidates(
    frame: RGBDFrame, table: TableFrame, labels: Labels, given: bool = False, most: int | None = None
) -> tuple[Candidate, ...]:
    """Measure each segment; if ``given`` by the user, segments of any size are objects.

    Segments with labels above ``most`` may only support others.

    Raises:
        InputError: nothing stands on the table, or one object fills it.
    """
    eye = np.asarray(table.T_robot_cam)[:3, 3]
    clouds: dict[int, Array] = {}
    counts: dict[int, int] = {}
    for label, pixels in enumerate(pixels_by_label(np.where(frame.depth > 0, labels, 0)), 1):
        step = len(pixels) // CONFIG.most + 1
        points = pixels_to_robot_frame(frame, table, *divmod(pixels[::step], labels.shape[1]))
        # Without few points far behind or before all others along the view: a sensor may see past an object.
        ranges = np.linalg.norm(points - eye, axis=1)
        order = np.argsort(ranges, kind="stable")
        group = np.zeros(len(points), np.int64)
        group[order[1:]] = np.cumsum(np.diff(ranges[order]) > CONFIG.gap)
        cloud = points.compress((np.bincount(group, minlength=1) >= CONFIG.few * len(points))[group], axis=0)
        if len(cloud) * step >= CONFIG.fewest:
            clouds[label], counts[label] = cloud, len(cloud) * step
    supports = {
        label: (convex_footprint_hull(cloud[::5]), float(compute_percentiles(cloud[::5, 2], [95])[0]))
        for label, cloud in clouds.items()
    }
    candidates: list[Candidate] = []
    too_large: Vec3 | None = None
    for label, cloud in clouds.items():
        if most is not None and label > most:
            continue
        others = [support for key, support in supports.items() if key != label]
        sampled = cloud, counts[label]
        candidate = _measure_candidate(len(candidates) + 1, frame, table, labels == label, sampled, others)
        if max(candidate.upright.size) > CONFIG.largest and not given:
            too_large = candidate.upright.size
        else:
            candidates.append(replace(candidate, given=given))
    if candidates:
        return tuple(candidates)
    problem, remedy = "found nothing on the table", "put objects of at least 2 cm on it"
    if too_large is not None:
        problem = "one thing of {:.2f} x {:.2f} x {:.2f} m fills the table".format(*too_large)
        remedy = f"photograph objects of at most {CONFIG.largest} m"
    raise InputError("; ".join([f"{frame.source}: {problem}", *describe_table_doubts(table)]), remedy)


def measure_beside_others(
    frame: RGBDFrame, table: TableFrame, masks: Sequence[Mask], others: Sequence[Mask]
) -> tuple[Candidate, ...] | None:
    """Measure segments with ``masks`` (H, W), numbered from 1, that may stand on ``others`` (H, W).

    Returns:
        The segments, or None if one of them has too few measured pixels or is too large for an object.
    """
    labels = np.zeros(frame.depth.shape, np.int32)
    for label, mask in enumerate(others, len(masks) + 1):
        labels[mask] = label
    for label, mask in enumerate(masks, 1):
        labels[mask] = label
    try:
        measured = measure_candidates(frame, table, labels)[: len(masks)]
    except InputError:
        return None
    complete = len(measured) == len(masks)
    same = complete and all(np.array_equal(item.mask, labels == label) for label, item in enumerate(measured, 1))
    return measured if same else None


def _measure_candidate(
    number: int,
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
    sampled: tuple[Array, int],
    others: Sequence[tuple[Array, float]],
) -> Candidate:
    """Box, footprint, colour and crop of a segment (H, W).

    Args:
        sampled: its cloud (N, 3) in the robot frame, and the count of its measured points.
        others: the footprint's hull and the top of each other segment, m.
    """
    cloud, count = sampled
    cloud = cloud[:: len(cloud) // (2 * CONFIG.samples) + 1]
    low, high = compute_percentiles(cloud, (1, 99))
    inner = cloud.compress(points_in_box_mask(cloud, low, high), axis=0)
    top = max(float(high[2]), THINNEST)
    # Down to the table, or to the top of the segment below if it is stacked.
    sparse, bottom = inner[::5], 0.0
    lowest = float(compute_percentiles(sparse[:, 2], [2])[0])
    if lowest >= 0.025 and any(
        abs(height - lowest) < 0.04 and points_in_hull_mask(sparse[:, :2], hull, margin=0.005).mean() > 0.4
        for hull, height in others
    ):
        bottom = max(min(lowest, top - THINNEST), 0.0)
    hollow = is_open_at_top(inner[:: len(inner) // CONFIG.samples + 1], np.zeros((0, 3)))
    shape, (x, y), (length, width), yaw, rounded = _fit_footprint(frame, table, mask, cloud, hollow)
    cosine, sine = abs(math.cos(yaw)), abs(math.sin(yaw))
    sides = np.array([[length * cosine, width * sine], [length * sine, width * cosine]]) / 2
    reach = np.hypot(*sides.T) if rounded else sides.sum(axis=1)
    middle = np.array([x, y])
    least, most = np.minimum(low[:2], middle - reach), np.maximum(high[:2], middle + reach)
    return Candidate(
        id=number,
        mask=mask,
        crop=crop_segment(frame, mask),
        box=Aabb(low=to_vec3((*least, bottom)), high=to_vec3((*most, top))),
        upright=UprightBox(center=(x, y, (bottom + top) / 2), size=(length, width, top - bottom), yaw=yaw),
        color=to_vec3(values_in_mask(frame.rgb, mask).mean(axis=0) / 255),
        shape=shape,
        points=count,
        hollow=hollow,
    )


def _fit_footprint(
    frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array, hollow: bool
) -> tuple[Solid, tuple[float, float], tuple[float, float], float, bool]:
    """Shape, centre, sides (m), yaw (rad) of a footprint, and whether it is round: then it includes the unseen back."""
    low, high = compute_percentiles(cloud, (CONFIG.outliers, 100 - CONFIG.outliers))
    inner = cloud.compress(points_in_box_mask(cloud, low, high), axis=0)
    inner = inner[:: len(inner) // CONFIG.samples + 1]
    if hollow and (rim := fit_bowl_rim(inner)) is not None:
        return "cylinder", rim[0], (rim[1], rim[1]), 0.0, True
    view = compute_view_frame(frame, table, mask, inner)
    ellipse = None if view is None else fit_elliptic_footprint(inner, view)
    if ellipse is not None:
        # Points beyond the ellipse contradict it: a half-hidden object may look round, a mug has a handle.
        axes = axes_from_yaws(np.array([ellipse.yaw]))[0]
        low, high = compute_percentiles((inner[:, :2] - ellipse.center) @ axes.T, (1, 99))
        if (np.maximum(-low, high) < (0.5 + CONFIG.overhang) * np.array(ellipse.diameters)).all():
            if ellipse.diameters[1] < CONFIG.round.round * ellipse.diameters[0]:
                return "box", ellipse.center, ellipse.diameters, ellipse.yaw, True
            diameter = sum(ellipse.diameters) / 2
            return "cylinder", ellipse.center, (diameter, diameter), 0.0, True
    # A circle: the four corners of the smallest rectangle are empty, and its sides are alike.
    (x, y), (length, width), _ = cv2.minAreaRect(inner[:, :2].astype(np.float32))
    area = cv2.contourArea(convex_footprint_hull(inner).astype(np.float32))
    if min(length, width) >= THINNEST and 0.68 < area / (length * width) < 0.87 and 0.75 < length / width < 1.33:
        diameter = (float(length) + float(width)) / 2
        return "cylinder", (float(x), float(y)), (diameter, diameter), 0.0, True
    return "box", *fit_smallest_rectangle(inner), False


def explain_doubt(frame: RGBDFrame, mask: Mask) -> str:
    """Reason why no task can be sure of the object of a mask (H, W): its measured pixels are few, or cover a small
    area across the view. Empty if tasks can be sure of it."""
    depth = frame.depth[mask]
    depth = depth[depth > 0].astype(np.float64)
    area = float((depth**2).sum()) / (frame.camera.fx * frame.camera.fy)
    if len(depth) >= CONFIG.sure_pixels * mask.size and area >= CONFIG.sure_area:
        return ""
    return f"{SEEN_TOO_SPARSELY} to be sure of it: {len(depth)} measured pixels, {area * 1e4:.1f} cm2"


def crop_segment(
    frame: RGBDFrame, mask: Mask, margin: float = 0.15
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The segment's rectangle with a margin; pixels of other segments are dimmed."""
    rows, columns = mask_bounding_slices(mask)
    pad = int(margin * (max(rows.stop - rows.start, columns.stop - columns.start) - 1)) + 4
    wide = np.s_[max(0, rows.start - pad) : rows.stop + pad, max(0, columns.start - pad) : columns.stop + pad]
    crop = frame.rgb[wide]
    return np.asarray(cv2.copyTo(crop, mask[wide].astype(np.uint8), cv2.LUT(crop, DIMMED)), np.uint8)


def shift_to_workspace(table: TableFrame, candidates: Sequence[Candidate]) -> Array:
    """Shift (3,), m, of a frame laid on the table that brings objects into the arm's workspace; 0 if it is calibrated.

    The middle of all objects comes to the middle of the workspace, or an object with which more are in reach."""
    if table.origin == "calibrated":
        return np.zeros(3)
    lows = np.array([candidate.box.low for candidate in candidates])
    highs = np.array([candidate.box.high for candidate in candidates])
    middle = ((lows.min(axis=0) + highs.max(axis=0)) / 2)[:2]
    centers = np.array([candidate.box.center for candidate in candidates])[:, :2]
    target = np.array(CONFIG.workspace_center)

    def rank(place: Array) -> tuple[int, float]:
        moved = centers - place + target
        reached = sum(is_reachable_position((float(x), float(y), 0.0)) for x, y in moved)
        return reached, -float(np.linalg.norm(place - middle))

    best = max((middle, *centers), key=rank)
    return np.array([*(target - best), 0.0])


def center_objects_in_workspace(
    table: TableFrame, candidates: Sequence[Candidate]
) -> tuple[TableFrame, tuple[Candidate, ...]]:
    """Shift a frame laid on the table so that the objects are in the arm's workspace; a calibrated frame stays."""
    if table.origin == "calibrated":
        return table, tuple(candidates)
    shift = shift_to_workspace(table, candidates)
    transform = np.array(table.T_robot_cam)
    transform[:3, 3] += shift
    moved: list[Candidate] = []
    for candidate in candidates:
        box, upright = candidate.box, candidate.upright
        shifted = Aabb(low=to_vec3(np.array(box.low) + shift), high=to_vec3(np.array(box.high) + shift))
        center = to_vec3(np.array(upright.center) + shift)
        moved.append(replace(candidate, box=shifted, upright=upright.model_copy(update={"center": center})))
    return table.model_copy(update={"T_robot_cam": matrix_to_tuples(transform)}), tuple(moved)


def fit_asset_to_box(upright: UprightBox, size: Vec3) -> tuple[Vec3, Quat, Vec3]:
    """Lay an asset of ``size`` (upright extents, m) into a measured box by the axis-aligned rotation that fits best.

    Returns: Its centre, its rotation (xyzw), and its extents after the rotation, before the yaw.
    """
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    about_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1.0, 0]])
    about_y = np.array([[0, 0, 1], [0, 1, 0], [-1.0, 0, 0]])
    best: tuple[float, Array, Vec3] | None = None
    for turn in (np.eye(3), quarter, about_x, about_y, quarter @ about_x, quarter @ about_y):
        extents = np.abs(turn @ np.array(size))
        misfit = float(np.abs(np.log(extents / np.array(upright.size))).sum())
        misfit += 0.0 if turn[2, 2] > 0.5 else 0.05  # upright unless another rotation fits better
        if best is None or misfit < best[0] - 1e-9:
            best = misfit, turn, to_vec3(extents)
    assert best is not None
    _, turn, extents = best
    bottom = upright.center[2] - upright.size[2] / 2
    cosine, sine = math.cos(upright.yaw), math.sin(upright.yaw)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]]) @ turn
    return (upright.center[0], upright.center[1], bottom + extents[2] / 2), matrix_to_quaternion(rotation), extents
