"""Geometry of masks, labels and footprints."""

from collections.abc import Sequence
from typing import Any, TypeVar

import cv2
import cv2.typing
import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Array, Mask

Labels = npt.NDArray[np.int32]
Index = npt.NDArray[np.intp]
Value = TypeVar("Value", bound=np.generic)
THINNEST = 0.012  # least width of a footprint (m): thinner objects are seen edge on
ALIKE = 1.08  # ratio of areas below which rectangles fit equally well


def depth_in_metres(units: "npt.NDArray[np.number[Any]]", scale: float) -> npt.NDArray[np.float32]:
    """(H, W) depth of ``scale`` metres per unit, computed in 64 bits without a copy of the picture in them."""
    return np.multiply(units, scale, out=np.empty(units.shape, np.float32), dtype=np.float64, casting="same_kind")


def label_connected_components(mask: cv2.typing.MatLike, smallest: int) -> Labels:
    """Number the 4-connected components of at least ``smallest`` pixels from 1; the rest is 0."""
    _, found = cv2.connectedComponents(mask, connectivity=4)
    labels = np.asarray(found, np.int32)
    if smallest <= 1:
        return labels
    pixels = np.flatnonzero(mask)
    owners = labels.ravel().take(pixels)
    large = np.bincount(owners, minlength=1) >= smallest  # faster than connectedComponentsWithStats
    large[0] = False
    labels.put(pixels, np.where(large, np.cumsum(large), 0).take(owners))
    return labels


def pixels_by_label(labels: Labels) -> list[Index]:
    """The pixels of each label from 1, as flat indices in the picture's order."""
    pixels = np.flatnonzero(labels > 0)
    owners = labels.ravel().take(pixels)
    counts = np.bincount(owners, minlength=int(labels.max()) + 1)
    order = np.argsort(owners.astype(np.min_scalar_type(len(counts))), kind="stable")  # small integers: radix sort
    return np.split(pixels[order], np.cumsum(counts[1:]))[:-1]


def values_in_mask(picture: npt.NDArray[Value], mask: Mask) -> npt.NDArray[Value]:
    """(N, D) values of a picture (H, W, D) at the pixels of a mask (H, W); much faster than boolean indexing."""
    return picture.reshape(-1, picture.shape[-1]).take(np.flatnonzero(mask), axis=0)


def pixels_in_mask(mask: Mask) -> tuple[Index, Index]:
    """Rows and columns of the pixels of a mask (H, W), as `np.nonzero`; much faster for few pixels."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns


def mask_bounding_slices(mask: Mask) -> tuple[slice, slice]:
    """Bounding rows and columns of a mask (H, W)."""
    rows = np.flatnonzero(mask.any(axis=1))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    tall = slice(int(rows[0]), int(rows[-1]) + 1)
    columns = np.flatnonzero(mask[tall].any(axis=0))
    return tall, slice(int(columns[0]), int(columns[-1]) + 1)


def grow_window(window: tuple[slice, slice], reach: int) -> tuple[slice, slice]:
    """A window of rows and columns, grown by ``reach`` pixels on each side within the picture."""
    rows, columns = window
    return slice(max(0, rows.start - reach), rows.stop + reach), slice(
        max(0, columns.start - reach), columns.stop + reach
    )


def mask_outline_pixels(mask: Mask) -> npt.NDArray[np.int32]:
    """(M, 2) column and row of each pixel of the outer borders of a mask (H, W)."""
    window = mask_bounding_slices(mask)
    inner = mask[window].astype(np.uint8)
    offset = (window[1].start, window[0].start)
    outlines, _ = cv2.findContours(inner, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=offset)
    return np.concatenate(outlines).reshape(-1, 2).astype(np.int32)


def convex_outline_mask(mask: Mask) -> Mask:
    """(H, W) pixels within the convex hull of a nonempty mask."""
    hull = cv2.convexHull(mask_outline_pixels(mask))
    return np.asarray(cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), hull, 1), np.bool_)


def compute_percentiles(values: Array, shares: Sequence[float]) -> Array:
    """(K,) or (K, D) as `np.percentile` along the first axis, several times as fast for some thousand values.

    ``values`` are (N,) or (N, D), finite, N > 0; ``shares`` (K,) per cent."""
    ordered = np.sort(np.ascontiguousarray(values.T), axis=-1)
    place = np.asarray(shares) / 100 * (len(values) - 1)
    below = place.astype(np.intp)
    share = place - below
    low, high = ordered[..., below], ordered[..., np.minimum(below + 1, len(values) - 1)]
    return np.where(share < 0.5, low + (high - low) * share, high - (high - low) * (1 - share)).T


def points_in_box_mask(points: Array, low: Array, high: Array) -> Mask:
    """(N,) points (N, D) in the axis-aligned box from ``low`` to ``high``, both (D,)."""
    inside = np.ones(len(points), np.bool_)
    for axis in range(points.shape[1]):  # much faster than comparing rows
        inside &= (points[:, axis] >= low[axis]) & (points[:, axis] <= high[axis])
    return inside


def convex_footprint_hull(points: Array) -> Array:
    """(M, 2) corners of the convex footprint of (N, 2 or 3) points; a single corner if all points coincide."""
    footprint = np.asarray(points[:, :2], np.float32)
    if len(footprint) == 0 or (footprint == footprint[0]).all():
        return footprint[:1].astype(np.float64)
    return cv2.convexHull(footprint).reshape(-1, 2).astype(np.float64)


def points_in_hull_mask(points: Array, hull: Array, margin: float) -> Mask:
    """(N,) points (N, 2) in the convex ``hull`` (M, 2) grown by ``margin`` metres."""
    if len(hull) < 3:
        return np.zeros(len(points), np.bool_)
    edges = np.concatenate([hull[1:], hull[:1]]) - hull
    lengths = np.maximum(np.linalg.norm(edges, axis=1), 1e-9)
    normals = edges[:, ::-1] * (1.0, -1.0) / lengths[:, None]
    normals *= np.where(((hull - hull.mean(axis=0)) * normals).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    offsets = (hull * normals).sum(axis=1)
    return np.asarray((normals @ points.T <= (offsets + margin)[:, None]).all(axis=0), np.bool_)


def axes_from_yaws(yaws: Array) -> Array:
    """(N, 2, 2) the x and the y axis of a footprint at each of (N,) yaws (rad)."""
    return np.stack([np.cos(yaws), np.sin(yaws), -np.sin(yaws), np.cos(yaws)], axis=1).reshape(-1, 2, 2)


def fit_smallest_rectangle(cloud: Array) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Smallest rectangle around 99 % of the points along each side.

    For two walls that meet in a corner, rectangles at several yaws are about equally small: of these the rectangle with
    sides nearest to the points is taken.

    Returns: Centre, sides (m) and yaw (rad, within 45 degrees).
    """
    flat = cloud[:: len(cloud) // 1000 + 1, :2]
    yaws = np.deg2rad(np.arange(-45.0, 45.0, 1.5))
    axes = axes_from_yaws(yaws)
    along = flat @ axes.reshape(-1, 2).T
    low, high = compute_percentiles(along, (0.5, 99.5))
    off = np.minimum(along - low, high - along)
    off = np.minimum(off[:, 0::2], off[:, 1::2])
    low, high = low.reshape(-1, 2), high.reshape(-1, 2)
    sides = np.maximum(high - low, THINNEST)
    areas = sides.prod(axis=1)
    best = int(np.where(areas <= ALIKE * areas.min(), np.abs(off).mean(axis=0), np.inf).argmin())
    x, y = (low[best] + high[best]) / 2 @ axes[best]
    return (float(x), float(y)), (float(sides[best, 0]), float(sides[best, 1])), float(yaws[best])


def share_of_borders(pieces: Labels, mask: Mask) -> Array:
    """(N + 1,) share of the border of each piece, from 1 in ``pieces`` (H, W), along the ``mask`` (H, W)."""
    border, enclosed = np.zeros((2, int(pieces.max()) + 1))
    for first, second in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        for inner, outer in ((first, second), (second, first)):
            edge = (pieces[inner] > 0) & (pieces[outer] != pieces[inner])
            border += np.bincount(pieces[inner][edge], minlength=len(border))
            enclosed += np.bincount(pieces[inner][edge & mask[outer]], minlength=len(border))
    return np.asarray(enclosed / np.maximum(border, 1), np.float64)
