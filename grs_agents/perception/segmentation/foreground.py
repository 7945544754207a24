"""What stands on the table: smoothed depth, the table's extent, and the pixels above it."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.frame import Array, Mask, RGBDFrame
from grs_agents.perception.image_geometry import components, hull_of, inside_hull, pixels_of, values_at
from grs_agents.perception.table import tolerance

Depth = npt.NDArray[np.float32]
TALLEST = 0.6
"""What rises higher above the table (m) is not an object on it."""
LOWEST = 0.006
SEEN_THROUGH = 0.1
"""Two pieces of plane are one table unless so large a share of what lies between them shows something lower."""
LOWER = 0.05
"""What is so much (m) lower than the table top is seen beside it, not on it."""
HIDDEN = 0.15
"""Objects may stand this far (m) from the visible table, on its near part that is out of the picture."""
CROSS = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))


def smoothed(frame: RGBDFrame) -> RGBDFrame:
    """The frame with small holes of its depth filled and noise smoothed without crossing edges."""
    depth = frame.depth.copy()
    closed = cv2.morphologyEx(depth, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    depth[depth == 0] = closed[depth == 0]
    depth = cv2.medianBlur(depth, 5)
    soft = cv2.bilateralFilter(depth, 9, 0.012, 4).astype(np.float32)
    soft[depth == 0] = 0
    return RGBDFrame(frame.rgb, soft, frame.camera, frame.source)


def jumps(depth: Depth) -> tuple[Mask, Mask]:
    """Where a pixel and its lower, and its right, neighbour lie on different surfaces: two (H, W) masks."""
    bound = 0.008 + 0.008 * depth
    below, right = np.zeros(depth.shape, np.bool_), np.zeros(depth.shape, np.bool_)
    below[:-1] = np.abs(np.diff(depth, axis=0)) > bound[:-1]
    right[:, :-1] = np.abs(np.diff(depth, axis=1)) > bound[:, :-1]
    return below, right


def foreground(points: Array, depth: Depth, eye: Array) -> Mask:
    """(H, W) pixels that are above the table and over it, or stand on it.

    Args:
        points: (H, W, 3) in the robot frame, NaN where unknown.
        depth: (H, W) metres.
        eye: (3,) where the camera is, robot frame.
    """
    height = points[..., 2]
    bound = tolerance(depth.astype(np.float64))
    flat = np.abs(height) < bound
    hull = _table_hull(points, flat, eye)
    if hull is None:
        return np.zeros(depth.shape, np.bool_)
    above = (height > np.maximum(bound, LOWEST)) & (height < TALLEST)
    above = cv2.morphologyEx(above.astype(np.uint8), cv2.MORPH_OPEN, CROSS).astype(np.bool_)
    inside = np.zeros(depth.shape, np.bool_)
    inside[above] = _over(values_at(points, above), hull, eye)
    return _standing(above, inside, depth)


def _over(points: Array, hull: Array, eye: Array) -> Mask:
    """Which of (N, 3) points are over the table, or near it and hide it from the camera's ``eye``.

    The near part of the table may be out of the picture, below the things that stand on it.
    """
    over = inside_hull(points[:, :2], hull, margin=0.02)
    rest = points.compress(~over, axis=0)
    share = rest[:, 2:] / np.minimum(rest[:, 2:] - eye[2], -1e-6)
    hidden = rest[:, :2] - share * (rest[:, :2] - eye[:2])
    over[~over] = inside_hull(rest[:, :2], hull, HIDDEN) & inside_hull(hidden, hull, 0.0)
    return over


def _standing(above: Mask, inside: Mask, depth: Depth) -> Mask:
    """Whole surfaces of which most is over the table: things reach beyond what is seen of it."""
    below, right = jumps(depth)
    cut = below | right
    cut[1:] |= below[:-1]
    cut[:, 1:] |= right[:, :-1]
    blobs = components((above & ~cut).astype(np.uint8), 1)
    total = np.bincount(blobs.ravel())
    over = np.bincount(blobs[inside], minlength=len(total))
    keep = over > 0.4 * total
    keep[0] = False
    return keep[blobs] | inside & (blobs == 0)


def _table_hull(points: Array, flat: Mask, eye: Array) -> Array | None:
    """(M, 2) corners of the visible table, over the gaps that objects make in it.

    The largest piece of plane is table, and so is every other piece, unless the camera sees something lower between
    them: then that one is a chair, a shelf or a floor of the same height.
    """
    labels = components(cv2.erode(flat.astype(np.uint8), np.ones((5, 5), np.uint8)), 50)
    if labels.max() == 0:
        return None
    found = pixels_of(labels)
    areas = np.array([0, *map(len, found)])
    order = [int(label) for label in np.argsort(-areas)[:20] if areas[label] > 0.005 * areas.max()]
    pieces = [points.reshape(-1, 3).take(found[label - 1][::7], axis=0)[:, :2] for label in order]
    hull = hull_of(pieces.pop(0))
    crossings, lower = _crossings(points, eye)
    while True:
        near = [piece for piece in pieces if not _apart(hull, piece, crossings, lower)]
        if not near:
            return hull
        pieces = [piece for piece in pieces if not any(piece is one for one in near)]
        hull = hull_of(np.concatenate([hull, *near]))


def _crossings(points: Array, eye: Array) -> tuple[Array, Mask]:
    """(N, 2) where the rays of some pixels cross the table's plane, m, and (N,) whether they end below it."""
    cloud = points[::4, ::4].reshape(-1, 3)
    cloud = cloud.compress(cloud[:, 2] < eye[2] - LOWER, axis=0)
    share = eye[2] / (eye[2] - cloud[:, 2:])
    return eye[:2] + share * (cloud[:, :2] - eye[:2]), cloud[:, 2] < -LOWER


def _apart(hull: Array, piece: Array, crossings: Array, lower: Mask) -> bool:
    """Whether something lower than the table is seen between its ``hull`` (M, 2) and another piece of plane (N, 2)."""
    both = hull_of(np.concatenate([hull, piece]))
    between = inside_hull(crossings, both, 0.0) & ~inside_hull(crossings, hull, 0.0)
    return bool(np.count_nonzero(between & lower) > SEEN_THROUGH * np.count_nonzero(between))
