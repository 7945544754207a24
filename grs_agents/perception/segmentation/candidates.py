"""From labels to candidates: boxes, colours and shapes of the segments; where the robot stands."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion
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
from grs_agents.perception.segmentation.ellipse_fit import Ellipse, compute_object_view, fit_elliptic_footprint
from grs_agents.perception.segmentation.hollow_shapes import is_open_at_top
from grs_agents.perception.segmentation.rim_fit import fit_bowl_rim
from grs_agents.perception.table_finding import describe_table_doubts, matrix_to_tuples, pixels_to_robot_frame
from grs_agents.perception.types import Aabb, Array, Candidate, Mask, RGBDFrame, Solid, TableFrame, UprightBox

CONFIG = DEFAULT.measuring

DIMMED = (np.arange(256) * 0.35).astype(np.uint8)  # what each brightness is outside of a segment's crop


def measure_candidates(
    frame: RGBDFrame, table: TableFrame, labels: Labels, given: bool = False
) -> tuple[Candidate, ...]:
    """Measure each segment; those that the user gave are objects, however large.
    Raises InputError: nothing stands on the table, or one object fills it."""
    counted = _clouds_by_label(frame, table, labels)
    clouds = {key: cloud for key, (cloud, count) in counted.items() if count >= CONFIG.fewest}
    supports = {
        label: (convex_footprint_hull(cloud[::5]), float(compute_percentiles(cloud[::5, 2], [95])[0]))
        for label, cloud in clouds.items()
    }
    candidates: list[Candidate] = []
    too_large: Vec3 | None = None
    for label, cloud in clouds.items():
        others = [support for key, support in supports.items() if key != label]
        sampled = cloud, counted[label][1]
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


def _clouds_by_label(frame: RGBDFrame, table: TableFrame, labels: Labels) -> dict[int, tuple[Array, int]]:
    """A sample of the measured points of each label from 1, (N, 3), row by row, robot frame, and how many there are."""
    eye = np.asarray(table.T_robot_cam)[:3, 3]
    clouds: dict[int, tuple[Array, int]] = {}
    for label, pixels in enumerate(pixels_by_label(np.where(frame.depth > 0, labels, 0)), 1):
        step = len(pixels) // CONFIG.most + 1
        points = pixels_to_robot_frame(frame, table, *divmod(pixels[::step], labels.shape[1]))
        cloud = points.compress(_range_inlier_mask(points, eye), axis=0)
        clouds[label] = cloud, len(cloud) * step
    return clouds


def _range_inlier_mask(cloud: Array, eye: Array) -> Mask:
    """(N,) which of (N, 3) points are not few and far behind or before all others: a sensor may see past an object."""
    ranges = np.linalg.norm(cloud - eye, axis=1)
    order = np.argsort(ranges, kind="stable")
    group = np.zeros(len(cloud), np.int64)
    group[order[1:]] = np.cumsum(np.diff(ranges[order]) > CONFIG.gap)
    return np.asarray((np.bincount(group, minlength=1) >= CONFIG.few * len(cloud))[group], np.bool_)


def _measure_candidate(
    number: int,
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
    sampled: tuple[Array, int],
    others: Sequence[tuple[Array, float]],
) -> Candidate:
    cloud, count = sampled
    cloud = cloud[:: len(cloud) // (2 * CONFIG.samples) + 1]
    low, high = compute_percentiles(cloud, (1, 99))
    inner = cloud.compress(points_in_box_mask(cloud, low, high), axis=0)
    top = max(float(high[2]), THINNEST)
    bottom = max(min(_find_bottom_height(inner[::5], others), top - THINNEST), 0.0)  # the top is measured
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
        box=Aabb(low=_to_vec3((*least, bottom)), high=_to_vec3((*most, top))),
        upright=UprightBox(center=(x, y, (bottom + top) / 2), size=(length, width, top - bottom), yaw=yaw),
        color=_to_vec3(values_in_mask(frame.rgb, mask).mean(axis=0) / 255),
        shape=shape,
        points=count,
        hollow=hollow,
    )


def _fit_footprint(
    frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array, hollow: bool
) -> tuple[Solid, tuple[float, float], tuple[float, float], float, bool]:
    """Shape, centre, sides (m), yaw (rad) of a footprint, and whether it is round: then with its unseen back."""
    low, high = compute_percentiles(cloud, (CONFIG.outliers, 100 - CONFIG.outliers))
    inner = cloud.compress(points_in_box_mask(cloud, low, high), axis=0)
    inner = inner[:: len(inner) // CONFIG.samples + 1]
    if hollow and (rim := fit_bowl_rim(inner)) is not None:
        return "cylinder", rim[0], (rim[1], rim[1]), 0.0, True
    view = compute_object_view(frame, table, mask, inner)
    ellipse = None if view is None else fit_elliptic_footprint(inner, view)
    ellipse = ellipse if ellipse is not None and _ellipse_covers_points(ellipse, inner, CONFIG.overhang) else None
    if ellipse is not None and ellipse.diameters[1] < CONFIG.round.round * ellipse.diameters[0]:
        return "box", ellipse.center, ellipse.diameters, ellipse.yaw, True
    if ellipse is not None:
        diameter = sum(ellipse.diameters) / 2
        return "cylinder", ellipse.center, (diameter, diameter), 0.0, True
    if (circle := _detect_circular_footprint(inner)) is not None:
        return "cylinder", circle[0], (circle[1], circle[1]), 0.0, True
    return "box", *fit_smallest_rectangle(inner), False


def _ellipse_covers_points(ellipse: Ellipse, cloud: Array, overhang: float) -> bool:
    """Whether a footprint reaches as far as the points do: a half-hidden object may look round, a mug has a handle."""
    axes = axes_from_yaws(np.array([ellipse.yaw]))[0]
    low, high = compute_percentiles((cloud[:, :2] - ellipse.center) @ axes.T, (1, 99))
    return bool((np.maximum(-low, high) < (0.5 + overhang) * np.array(ellipse.diameters)).all())


def _detect_circular_footprint(cloud: Array) -> tuple[tuple[float, float], float] | None:
    """Centre and diameter (m) of a footprint whose four corners are missing and whose sides are alike."""
    (x, y), (length, width), _ = cv2.minAreaRect(cloud[:, :2].astype(np.float32))
    area = cv2.contourArea(convex_footprint_hull(cloud).astype(np.float32))
    if min(length, width) < THINNEST or not 0.68 < area / (length * width) < 0.87 or not 0.75 < length / width < 1.33:
        return None
    return (float(x), float(y)), (float(length) + float(width)) / 2


def _find_bottom_height(cloud: Array, others: Sequence[tuple[Array, float]]) -> float:
    """0 for what stands on the table; the top of what it lies on for what is stacked.
    ``others`` are the hull of the footprint and the top of each other object."""
    lowest = float(compute_percentiles(cloud[:, 2], [2])[0])
    if lowest < 0.025:
        return 0.0
    for hull, top in others:
        if abs(top - lowest) < 0.04 and points_in_hull_mask(cloud[:, :2], hull, margin=0.005).mean() > 0.4:
            return lowest
    return 0.0


def crop_segment(
    frame: RGBDFrame, mask: Mask, margin: float = 0.15
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The segment's rectangle with a margin; what does not belong to it is dimmed."""
    rows, columns = mask_bounding_slices(mask)
    pad = int(margin * (max(rows.stop - rows.start, columns.stop - columns.start) - 1)) + 4
    wide = np.s_[max(0, rows.start - pad) : rows.stop + pad, max(0, columns.start - pad) : columns.stop + pad]
    crop = frame.rgb[wide]
    return np.asarray(cv2.copyTo(crop, mask[wide].astype(np.uint8), cv2.LUT(crop, DIMMED)), np.uint8)


def center_objects_in_workspace(
    table: TableFrame, candidates: Sequence[Candidate]
) -> tuple[TableFrame, tuple[Candidate, ...]]:
    """Move a frame that is on the table so that the middle of the objects is in the arm's workspace.
    A calibrated frame is left as it is."""
    if table.origin == "calibrated":
        return table, tuple(candidates)
    lows = np.array([candidate.box.low for candidate in candidates])
    highs = np.array([candidate.box.high for candidate in candidates])
    middle = (lows.min(axis=0) + highs.max(axis=0)) / 2
    shift = np.array([CONFIG.workspace_center[0] - middle[0], CONFIG.workspace_center[1] - middle[1], 0.0])
    transform = np.array(table.T_robot_cam)
    transform[:3, 3] += shift
    moved = table.model_copy(update={"T_robot_cam": matrix_to_tuples(transform)})
    return moved, tuple(_translate_candidate(candidate, shift) for candidate in candidates)


def _translate_candidate(candidate: Candidate, shift: Array) -> Candidate:
    def shift_point(point: Vec3) -> Vec3:
        return _to_vec3(np.array(point) + shift)

    box = Aabb(low=shift_point(candidate.box.low), high=shift_point(candidate.box.high))
    upright = candidate.upright.model_copy(update={"center": shift_point(candidate.upright.center)})
    return replace(candidate, box=box, upright=upright)


def fit_asset_to_box(upright: UprightBox, size: Vec3) -> tuple[Vec3, Quat, Vec3]:
    """Lay an asset of ``size`` (upright extents, m) into a measured box: the axis-aligned turn that fits best.
    Returns: Its centre, its rotation (xyzw), and its extents after the turn, before the yaw."""
    best: tuple[float, Array, Vec3] | None = None
    for turn in _axis_aligned_rotations():
        extents = np.abs(turn @ np.array(size))
        misfit = float(np.abs(np.log(extents / np.array(upright.size))).sum())
        misfit += 0.0 if turn[2, 2] > 0.5 else 0.05  # upright unless another way fits better
        if best is None or misfit < best[0] - 1e-9:
            best = misfit, turn, _to_vec3(extents)
    assert best is not None
    _, turn, extents = best
    bottom = upright.center[2] - upright.size[2] / 2
    cosine, sine = math.cos(upright.yaw), math.sin(upright.yaw)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]]) @ turn
    return (upright.center[0], upright.center[1], bottom + extents[2] / 2), matrix_to_quaternion(rotation), extents


def _axis_aligned_rotations() -> list[Array]:
    """Upright, a quarter about z, and each of the four ways to lie."""
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    about_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1.0, 0]])
    about_y = np.array([[0, 0, 1], [0, 1, 0], [-1.0, 0, 0]])
    return [np.eye(3), quarter, about_x, about_y, quarter @ about_x, quarter @ about_y]


def _to_vec3(values: "Array | Sequence[float]") -> Vec3:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
