"""From labels to candidates: boxes, colours and shapes of the segments; where the robot stands."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.errors import InputError
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    THINNEST,
    Labels,
    hull_of,
    inside_hull,
    percentiles,
    pixels_of,
    rectangle_of,
    turns,
    values_at,
    window_of,
    within,
)
from grs_agents.perception.segmentation.ellipse_fit import Ellipse, ellipse_of, view_of
from grs_agents.perception.segmentation.hollow_shapes import is_open
from grs_agents.perception.segmentation.rim import rim_of
from grs_agents.perception.table import as_matrix, doubts, robot_points_at
from grs_agents.perception.types import Aabb, Array, Candidate, Mask, RGBDFrame, Solid, TableFrame, UprightBox

CONFIG = DEFAULT.measuring

DIMMED = (np.arange(256) * 0.35).astype(np.uint8)  # what each brightness is outside of a segment's crop


def candidates_of(frame: RGBDFrame, table: TableFrame, labels: Labels) -> tuple[Candidate, ...]:
    """Measure each segment.

    Raises:
        InputError: nothing stands on the table, or one object fills it.
    """
    clouds = {label: cloud for label, cloud in _clouds(frame, table, labels).items() if len(cloud) >= CONFIG.fewest}
    supports = {
        label: (hull_of(cloud[::5]), float(percentiles(cloud[::5, 2], [95])[0])) for label, cloud in clouds.items()
    }
    candidates: list[Candidate] = []
    too_large: Vec3 | None = None
    for label, cloud in clouds.items():
        others = [support for key, support in supports.items() if key != label]
        candidate = _measure(len(candidates) + 1, frame, table, labels == label, cloud, others)
        if max(candidate.upright.size) > CONFIG.largest:
            too_large = candidate.upright.size
        else:
            candidates.append(candidate)
    if candidates:
        return tuple(candidates)
    problem, remedy = "found nothing on the table", "put objects of at least 2 cm on it"
    if too_large is not None:
        problem = "one thing of {:.2f} x {:.2f} x {:.2f} m fills the table".format(*too_large)
        remedy = f"photograph objects of at most {CONFIG.largest} m"
    raise InputError("; ".join([f"{frame.source}: {problem}", *doubts(table)]), remedy)


def _clouds(frame: RGBDFrame, table: TableFrame, labels: Labels) -> dict[int, Array]:
    """The (N, 3) measured points of each label from 1, row by row, robot frame."""
    pixels = pixels_of(np.where(frame.depth > 0, labels, 0))
    eye = np.asarray(table.T_robot_cam)[:3, 3]
    clouds = (robot_points_at(frame, table, *divmod(own, labels.shape[1])) for own in pixels)
    return {label: cloud.compress(_at_one_range(cloud, eye), axis=0) for label, cloud in enumerate(clouds, 1)}


def _at_one_range(cloud: Array, eye: Array) -> Mask:
    """(N,) which of (N, 3) points are not few and far behind or before all others: a sensor may see past an object."""
    ranges = np.linalg.norm(cloud - eye, axis=1)
    order = np.argsort(ranges, kind="stable")
    group = np.zeros(len(cloud), np.int64)
    group[order[1:]] = np.cumsum(np.diff(ranges[order]) > CONFIG.gap)
    return np.asarray((np.bincount(group, minlength=1) >= CONFIG.few * len(cloud))[group], np.bool_)


def _measure(
    number: int, frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array, others: Sequence[tuple[Array, float]]
) -> Candidate:
    count, cloud = len(cloud), cloud[:: len(cloud) // (2 * CONFIG.samples) + 1]
    low, high = percentiles(cloud, (1, 99))
    inner = cloud.compress(within(cloud, low, high), axis=0)
    bottom = _bottom(inner[::5], others)
    top = max(float(high[2]), bottom + THINNEST)
    hollow = is_open(inner[:: len(inner) // CONFIG.samples + 1], np.zeros((0, 3)))
    shape, (x, y), (length, width), yaw, rounded = _footprint(frame, table, mask, cloud, hollow)
    cosine, sine = abs(math.cos(yaw)), abs(math.sin(yaw))
    sides = np.array([[length * cosine, width * sine], [length * sine, width * cosine]]) / 2
    reach = np.hypot(*sides.T) if rounded else sides.sum(axis=1)
    middle = np.array([x, y])
    least, most = np.minimum(low[:2], middle - reach), np.maximum(high[:2], middle + reach)
    return Candidate(
        id=number,
        mask=mask,
        crop=_crop(frame, mask),
        box=Aabb(low=_vec((*least, bottom)), high=_vec((*most, top))),
        upright=UprightBox(center=(x, y, (bottom + top) / 2), size=(length, width, top - bottom), yaw=yaw),
        color=_vec(values_at(frame.rgb, mask).mean(axis=0) / 255),
        shape=shape,
        points=count,
        hollow=hollow,
    )


def _footprint(
    frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array, hollow: bool
) -> tuple[Solid, tuple[float, float], tuple[float, float], float, bool]:
    """Shape, centre, sides (m), yaw (rad) of a footprint, and whether it is round: then with its unseen back."""
    low, high = percentiles(cloud, (CONFIG.outliers, 100 - CONFIG.outliers))
    inner = cloud.compress(within(cloud, low, high), axis=0)
    inner = inner[:: len(inner) // CONFIG.samples + 1]
    if hollow and (rim := rim_of(inner)) is not None:
        return "cylinder", rim[0], (rim[1], rim[1]), 0.0, True
    view = view_of(frame, table, mask, inner)
    ellipse = None if view is None else ellipse_of(inner, view)
    ellipse = ellipse if ellipse is not None and _reaches_all(ellipse, inner, CONFIG.overhang) else None
    if ellipse is not None and ellipse.diameters[1] < CONFIG.round.round * ellipse.diameters[0]:
        return "box", ellipse.center, ellipse.diameters, ellipse.yaw, True
    if ellipse is not None:
        diameter = sum(ellipse.diameters) / 2
        return "cylinder", ellipse.center, (diameter, diameter), 0.0, True
    if (circle := _circle(inner)) is not None:
        return "cylinder", circle[0], (circle[1], circle[1]), 0.0, True
    return "box", *rectangle_of(inner), False


def _reaches_all(ellipse: Ellipse, cloud: Array, overhang: float) -> bool:
    """Whether a footprint reaches as far as the points do: a half-hidden object may look round, a mug has a handle."""
    axes = turns(np.array([ellipse.yaw]))[0]
    low, high = percentiles((cloud[:, :2] - ellipse.center) @ axes.T, (1, 99))
    return bool((np.maximum(-low, high) < (0.5 + overhang) * np.array(ellipse.diameters)).all())


def _circle(cloud: Array) -> tuple[tuple[float, float], float] | None:
    """Centre and diameter (m) of a footprint whose four corners are missing and whose sides are alike."""
    footprint = cloud[:, :2].astype(np.float32)
    (x, y), (length, width), _ = cv2.minAreaRect(footprint)
    area = cv2.contourArea(hull_of(cloud).astype(np.float32))
    if min(length, width) < THINNEST or not 0.68 < area / (length * width) < 0.87 or not 0.75 < length / width < 1.33:
        return None
    return (float(x), float(y)), (float(length) + float(width)) / 2


def _bottom(cloud: Array, others: Sequence[tuple[Array, float]]) -> float:
    """0 for what stands on the table; the top of what it lies on for what is stacked.

    ``others`` are the hull of the footprint and the top of each other object.
    """
    lowest = float(percentiles(cloud[:, 2], [2])[0])
    if lowest < 0.025:
        return 0.0
    for hull, top in others:
        if abs(top - lowest) < 0.04 and inside_hull(cloud[:, :2], hull, margin=0.005).mean() > 0.4:
            return lowest
    return 0.0


def _crop(frame: RGBDFrame, mask: Mask, margin: float = 0.15) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The segment's rectangle with a margin; what does not belong to it is dimmed."""
    rows, columns = window_of(mask)
    pad = int(margin * (max(rows.stop - rows.start, columns.stop - columns.start) - 1)) + 4
    wide = np.s_[max(0, rows.start - pad) : rows.stop + pad, max(0, columns.start - pad) : columns.stop + pad]
    crop = frame.rgb[wide]
    return np.where(mask[wide][..., None], crop, DIMMED[crop])


def place_robot(table: TableFrame, candidates: Sequence[Candidate]) -> tuple[TableFrame, tuple[Candidate, ...]]:
    """Move a frame that is on the table so that the middle of the objects is in the arm's workspace.

    A calibrated frame is left as it is.
    """
    if table.origin == "calibrated":
        return table, tuple(candidates)
    lows = np.array([candidate.box.low for candidate in candidates])
    highs = np.array([candidate.box.high for candidate in candidates])
    middle = (lows.min(axis=0) + highs.max(axis=0)) / 2
    shift = np.array([CONFIG.workspace_center[0] - middle[0], CONFIG.workspace_center[1] - middle[1], 0.0])
    transform = np.array(table.T_robot_cam)
    transform[:3, 3] += shift
    moved = table.model_copy(update={"T_robot_cam": as_matrix(transform)})
    return moved, tuple(_moved(candidate, shift) for candidate in candidates)


def _moved(candidate: Candidate, shift: Array) -> Candidate:
    def move(point: Vec3) -> Vec3:
        return _vec(np.array(point) + shift)

    box = Aabb(low=move(candidate.box.low), high=move(candidate.box.high))
    upright = candidate.upright.model_copy(update={"center": move(candidate.upright.center)})
    return replace(candidate, box=box, upright=upright)


def place_asset(upright: UprightBox, size: Vec3) -> tuple[Vec3, Quat, Vec3]:
    """Lay an asset of ``size`` (upright extents, m) into a measured box: the axis-aligned turn that fits best.

    Returns:
        Its centre, its rotation (xyzw), and its extents after the turn, before the yaw.
    """
    best: tuple[float, Array, Vec3] | None = None
    for turn in _turns():
        extents = np.abs(turn @ np.array(size))
        misfit = float(np.abs(np.log(extents / np.array(upright.size))).sum())
        misfit += 0.0 if turn[2, 2] > 0.5 else 0.05  # upright unless another way fits better
        if best is None or misfit < best[0] - 1e-9:
            best = misfit, turn, _vec(extents)
    assert best is not None
    _, turn, extents = best
    bottom = upright.center[2] - upright.size[2] / 2
    cosine, sine = math.cos(upright.yaw), math.sin(upright.yaw)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]]) @ turn
    return (upright.center[0], upright.center[1], bottom + extents[2] / 2), quaternion(rotation), extents


def _turns() -> list[Array]:
    """Upright, a quarter about z, and each of the four ways to lie."""
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    about_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1.0, 0]])
    about_y = np.array([[0, 0, 1], [0, 1, 0], [-1.0, 0, 0]])
    return [np.eye(3), quarter, about_x, about_y, quarter @ about_x, quarter @ about_y]


def quaternion(rotation: Array) -> Quat:
    """A rotation matrix as (x, y, z, w) with w >= 0."""
    w = math.sqrt(max(0.0, 1 + float(np.trace(rotation)))) / 2
    xyz = [
        math.copysign(math.sqrt(max(0.0, 1 + 2 * float(rotation[i, i]) - float(np.trace(rotation)))) / 2, sign)
        for i, sign in (
            (0, rotation[2, 1] - rotation[1, 2]),
            (1, rotation[0, 2] - rotation[2, 0]),
            (2, rotation[1, 0] - rotation[0, 1]),
        )
    ]
    if w < 1e-6:  # half a turn: the signs come from the products
        axis = int(np.argmax(np.abs(xyz)))
        xyz = [abs(value) * (1 if i == axis else math.copysign(1, rotation[axis, i])) for i, value in enumerate(xyz)]
    norm = math.sqrt(sum(value * value for value in xyz) + w * w)
    return (xyz[0] / norm, xyz[1] / norm, xyz[2] / norm, w / norm)


def _vec(values: "Array | Sequence[float]") -> Vec3:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
