"""Foreground (objects on the table), cut into smooth patches at creases and depth jumps.

The surface is first over-segmented at every concave bend or jump. Then neighbours are joined, the smoothest border
first, as long as the mean strength of their whole common border is low. So local noise does not cut an object, and a
gap in a crease does not join two.
"""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    convex_footprint_hull,
    label_connected_components,
    mask_bounding_slices,
    pixels_by_label,
    points_in_hull_mask,
    values_in_mask,
)
from grs_agents.perception.plane_fitting import depth_tolerance
from grs_agents.perception.segmentation.configuration import Foreground, PatchCutting
from grs_agents.perception.types import Array, Mask, RGBDFrame

Depth = npt.NDArray[np.float32]
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))  # of chords: rows and columns


def smooth_frame_depth(frame: RGBDFrame) -> RGBDFrame:
    """The frame with small holes of its depth filled and noise smoothed without crossing edges."""
    depth = frame.depth.copy()
    closed = cv2.morphologyEx(depth, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    depth[depth == 0] = closed[depth == 0]
    depth = cv2.medianBlur(depth, 5)
    soft = cv2.bilateralFilter(depth, 9, 0.012, 4).astype(np.float32)
    soft[depth == 0] = 0
    return RGBDFrame(frame.rgb, soft, frame.camera, frame.source)


def find_depth_jumps(depth: Depth) -> tuple[Mask, Mask]:
    """Masks (H, W) of pixels separated by a depth jump from their lower, and from their right, neighbour."""
    bound = 0.008 + 0.008 * depth
    below, right = np.zeros(depth.shape, np.bool_), np.zeros(depth.shape, np.bool_)
    below[:-1] = np.abs(np.diff(depth, axis=0)) > bound[:-1]
    right[:, :-1] = np.abs(np.diff(depth, axis=1)) > bound[:, :-1]
    return below, right


def depth_jump_mask(depth: Depth) -> Mask:
    """(H, W) pixels on either side of a jump."""
    below, right = find_depth_jumps(depth)
    edges = below | right
    edges[1:] |= below[:-1]
    edges[:, 1:] |= right[:, :-1]
    return edges


def foreground_pixel_mask(
    points: Array, frame: RGBDFrame, eye: Array, config: Foreground = DEFAULT.segmentation.foreground
) -> Mask:
    """(H, W) pixels that rise above the table and stand on it.

    ``points`` are (H, W, 3) of the frame in the robot frame, NaN where unknown; ``eye`` (3,) is the camera's position
    there."""
    height, depth = points[..., 2], frame.depth
    bound = depth_tolerance(depth.astype(np.float64))
    hull = find_table_hull(points, np.abs(height) < bound, eye, config)
    if hull is None:
        return np.zeros(depth.shape, np.bool_)
    above = (height > np.maximum(bound, config.lowest)) & (height < config.tallest)
    above = cv2.morphologyEx(above.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(np.bool_)
    raised = values_in_mask(points, above)
    over = points_in_hull_mask(raised[:, :2], hull, margin=0.02)
    # Or near the table and occluding it: the near part of the table may be out of the picture, below its objects.
    rest = raised.compress(~over, axis=0)
    share = rest[:, 2:] / np.minimum(rest[:, 2:] - eye[2], -1e-6)
    hidden = rest[:, :2] - share * (rest[:, :2] - eye[:2])
    near = points_in_hull_mask(rest[:, :2], hull, config.beyond_table)
    over[~over] = near & points_in_hull_mask(hidden, hull, config.hidden_table)
    inside = np.zeros(depth.shape, np.bool_)
    inside[above] = over
    # Whole surfaces, if most of them is over the table: objects reach beyond its visible part.
    blobs = label_connected_components((above & ~depth_jump_mask(depth)).astype(np.uint8), 1)
    whole = _mostly_within(blobs, inside)
    # Of other surfaces, such as a wall with an object that touches it, what a crease parts from the rest.
    beside = (blobs > 0) & ~whole
    if np.count_nonzero(beside & inside) > (smallest := int(DEFAULT.segmentation.filter.smallest * depth.size)):
        smooth = compute_concavity_map(frame, beside & inside) <= DEFAULT.segmentation.patches.crease
        whole |= _mostly_within(label_connected_components((beside & smooth).astype(np.uint8), smallest), inside)
    return whole | inside & (blobs == 0)


def _mostly_within(labels: Labels, mask: Mask) -> Mask:
    """(H, W) pixels of the labelled pieces of which enough lies in a mask (H, W)."""
    total = np.bincount(labels.ravel())
    keep = np.bincount(labels[mask], minlength=len(total)) > 0.4 * total
    keep[0] = False
    return keep[labels]


def find_table_hull(
    points: Array, flat: Mask, eye: Array, config: Foreground = DEFAULT.segmentation.foreground
) -> Array | None:
    """(M, 2) corners of the visible table, spanning the gaps behind objects; ``None`` without a piece of plane.

    ``flat`` (H, W) are the pixels in its plane. The largest piece of plane is table. So is every other piece, unless
    the camera sees something lower in between: then it is a chair, a shelf or a floor of the same height."""
    labels = label_connected_components(cv2.erode(flat.astype(np.uint8), np.ones((5, 5), np.uint8)), 50)
    if labels.max() == 0:
        return None
    found = pixels_by_label(labels)
    areas = np.array([0, *map(len, found)])
    order = [int(label) for label in np.argsort(-areas)[:20] if areas[label] > 0.005 * areas.max()]
    pieces = [points.reshape(-1, 3).take(found[label - 1][::7], axis=0)[:, :2] for label in order]
    hull = convex_footprint_hull(pieces.pop(0))
    # Intersections of a sample of the rays with the table plane, (N, 2), and whether the rays end below it.
    cloud = points[::4, ::4].reshape(-1, 3)
    cloud = cloud.compress(cloud[:, 2] < eye[2] - config.lower, axis=0)
    crossings = eye[:2] + eye[2] / (eye[2] - cloud[:, 2:]) * (cloud[:, :2] - eye[:2])
    lower = cloud[:, 2] < -config.lower
    while True:
        near: list[Array] = []
        far: list[Array] = []
        outside = ~points_in_hull_mask(crossings, hull, 0.0)
        for piece in pieces:
            both = convex_footprint_hull(np.concatenate([hull, piece]))
            between = points_in_hull_mask(crossings, both, 0.0) & outside
            share = np.count_nonzero(between & lower) / max(np.count_nonzero(between), 1)
            (near if share <= config.most_seen_through else far).append(piece)
        if not near:
            return hull
        pieces = far
        hull = convex_footprint_hull(np.concatenate([hull, *near]))


def cut_smooth_patches(
    frame: RGBDFrame, foreground: Mask, bend: Array, config: PatchCutting = DEFAULT.segmentation.patches
) -> Labels:
    """(H, W) labels of the smooth, jump-free surfaces in the foreground; 0 elsewhere. ``bend`` (H, W) is the map of
    `compute_concavity_map`."""
    cut = (bend > config.bend) | depth_jump_mask(frame.depth)
    cores = cv2.morphologyEx((foreground & ~cut).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    labels = grow_labels(label_connected_components(cores, 12), foreground, frame.depth)
    strength, jumps = np.minimum(bend, config.jump), find_depth_jumps(frame.depth)
    length, total = measure_label_borders(labels, strength, *jumps, config.jump)
    labels = join_smooth_neighbors(labels, length, total, np.ones(length.shape, np.bool_), config)
    return join_enclosed_fragments(labels, *measure_label_borders(labels, strength, *jumps, config.jump), config)


def compute_concavity_map(
    frame: RGBDFrame, foreground: Mask, config: PatchCutting = DEFAULT.segmentation.patches
) -> Array:
    """(H, W) concavity of the surface: sagitta over chord, the maximum of four directions.

    0 if the chord crosses a depth jump, and far from the foreground."""
    middle = float(np.median(frame.depth[foreground])) if foreground.any() else 1.0
    step = int(np.clip(np.rint(config.reach * frame.camera.fx / middle), 3, 24))
    rows, columns = mask_bounding_slices(foreground)
    around = tuple(slice(max(0, side.start - 2 * step), side.stop + 2 * step) for side in (rows, columns))
    points = frame.camera_frame_point_map()[around]
    x, y, z = np.ascontiguousarray(np.moveaxis(points, -1, 0))  # much faster than rows of three
    below, right = find_depth_jumps(frame.depth)
    jump = (below | right | (frame.depth <= 0))[around].astype(np.uint8)
    whole = np.zeros(frame.depth.shape)
    part = whole[around]
    for down, across in DIRECTIONS:
        length = max(2, round(step / float(np.hypot(down, across))))
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.uint8)  # a line through its middle
        steps = np.arange(-length, length + 1)
        kernel[length + down * steps, length + across * steps] = 1
        smooth = cv2.dilate(jump, kernel) == 0
        # The pixels before, at and after each pixel that has both ends of its chord in the window.
        drop, shift = down * length, across * length
        tall, wide = max(0, jump.shape[0] - 2 * drop), max(0, jump.shape[1] - 2 * abs(shift))
        before, here, after = (
            np.s_[top : top + tall, left : left + wide]
            for top, left in ((drop * (1 + way), abs(shift) + shift * way) for way in (-1, 0, 1))
        )
        chord = np.sqrt((x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2 + (z[after] - z[before]) ** 2)
        sag = z[here] - (z[before] + z[after]) / 2
        bend = np.where(smooth[here] & (chord < 6 * config.reach), sag / np.maximum(chord, 1e-6), 0.0)
        np.maximum(part[here], bend, out=part[here])
    return whole


def grow_labels(labels: Labels, foreground: Mask, depth: Depth, rounds: int = 14) -> Labels:
    """Region growing: assign unlabelled foreground pixels to the segment they touch, never across a depth jump."""
    below, right = (np.pad(jump, 1) for jump in find_depth_jumps(depth))
    result, row = np.pad(labels, 1), labels.shape[1] + 2
    empty = np.flatnonzero(np.pad(foreground, 1) & (result == 0))
    ways = ((below, 0, row), (below, -row, -row), (right, 0, 1), (right, -1, -1))
    # Pixel 0, which has no label, stands for a neighbour beyond a jump or the border.
    around = np.stack([np.where(jump.take(empty + edge), 0, empty + step) for jump, edge, step in ways])
    for _ in range(rounds):
        neighbors = result.take(around)
        taken = neighbors[(neighbors > 0).argmax(axis=0), np.arange(len(empty))]
        result.put(empty, taken)
        left = taken == 0
        if left.all():
            break
        empty, around = empty[left], around[:, left]
    return result[1:-1, 1:-1].copy()


def join_smooth_neighbors(labels: Labels, length: Array, total: Array, allowed: Mask, config: PatchCutting) -> Labels:
    """Join neighbours, the smoothest border first, until every remaining border is a crease or a jump.

    Args:
        labels: (H, W), 0..N.
        length: (N+1, N+1) of the border of every two labels, pixels; see `measure_label_borders`.
        total: (N+1, N+1) their summed strength.
        allowed: (N+1, N+1) pairs that may be joined; a joined segment inherits the permissions of its parts.
    """
    length, total, allowed = length.copy(), total.copy(), allowed.copy()
    owner = np.arange(len(length))
    mean = np.where(allowed & (length >= config.shortest), total / np.maximum(length, 1), np.inf)
    np.fill_diagonal(mean, np.inf)
    while mean.flat[smoothest := int(mean.argmin())] < config.crease:
        first, second = divmod(smoothest, len(mean))
        owner[owner == second] = first
        for table in (length, total, allowed):
            table[first] += table[second]
            table[:, first] = table[first]
            table[second] = table[:, second] = 0
            table[first, first] = 0
        mean[second] = mean[:, second] = np.inf
        joinable = allowed[first] & (length[first] >= config.shortest)
        row = np.where(joinable, total[first] / np.maximum(length[first], 1), np.inf)
        mean[first] = mean[:, first] = row
    _, numbers = np.unique(owner, return_inverse=True)
    return numbers.astype(np.int32)[labels]


def join_enclosed_fragments(labels: Labels, length: Array, total: Array, config: PatchCutting) -> Labels:
    """Join small pieces to the neighbour that encloses most of them, unless the border is more than a fold.

    Args:
        labels: (H, W), 0..N.
        length, total: (N+1, N+1) as `join_smooth_neighbors` takes them.
    """
    areas = np.bincount(labels.ravel(), minlength=len(length))
    around = np.where(total < config.fold * length, length, 0)
    owner = np.arange(len(length), dtype=np.int32)
    for small in np.argsort(areas[1:]) + 1:
        whole = around[small].argmax()
        is_enclosed = around[small, whole] > config.enclosed * np.sqrt(areas[small])
        if is_enclosed and areas[small] < config.fragment * areas[whole]:
            owner[owner == small] = owner[whole]
    return np.unique(owner, return_inverse=True)[1].astype(np.int32)[labels]


def measure_label_borders(
    labels: Labels, strength: Array, below: Mask, right: Mask, jump: float
) -> tuple[Array, Array]:
    """Length (pixels) and summed strength of the borders between labels 0..N, as (N+1, N+1) symmetric tables.

    Args:
        strength: (H, W) of a border that runs through each pixel.
        below, right: (H, W) depth jumps, as `find_depth_jumps` finds them.
        jump: strength of a border at a jump.
    """
    count = int(labels.max()) + 1
    length, total = np.zeros((count, count)), np.zeros((count, count))
    views: tuple[tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], Array, Mask], ...] = (
        (labels[:-1], labels[1:], np.maximum(strength[:-1], strength[1:]), below[:-1]),
        (labels[:, :-1], labels[:, 1:], np.maximum(strength[:, :-1], strength[:, 1:]), right[:, :-1]),
    )
    for first, second, strong, jumping in views:
        border = (first != second) & (first > 0) & (second > 0)
        index = first[border].astype(np.int64) * count + second[border]
        length += np.bincount(index, minlength=count**2).reshape(count, count)
        weight = np.where(jumping, jump, strong)[border]
        total += np.bincount(index, weights=weight, minlength=count**2).reshape(count, count)
    return length + length.T, total + total.T
