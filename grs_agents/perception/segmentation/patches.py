"""Cut the foreground into smooth patches and join those that meet without a crease.

First many patches, cut wherever the surface bends inwards or jumps at all; then neighbours are joined, the smoothest
border first, as long as the mean strength of their whole common border is low. So noise at one place does not cut an
object, and a gap in a crease does not join two."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.frame import Array, Mask, RGBDFrame
from grs_agents.perception.image_geometry import Labels, components, window_of
from grs_agents.perception.segmentation.foreground import Depth, jumps

BENT = 0.037
"""Sagitta over chord where patches are first cut: a concave bend of about 8 degrees, often mere noise."""
CREASE = 0.19
"""The mean over a border above which two patches stay apart."""
JUMP = 0.3
"""What a depth jump counts in a border's mean, and the most that a bend counts."""
REACH = 0.010
"""Bends are measured across this distance on the surface, metres."""
SHORTEST = 6
"""Borders shorter than this (pixels) say nothing."""
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def patches(frame: RGBDFrame, foreground: Mask) -> Labels:
    """(H, W) labels of the smooth, jump-free surfaces in the foreground; 0 elsewhere."""
    bend = bends(frame, foreground)
    below, right = jumps(frame.depth)
    cut = (bend > BENT) | below | right
    cut[1:] |= below[:-1]
    cut[:, 1:] |= right[:, :-1]
    cores = cv2.morphologyEx((foreground & ~cut).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    labels = grown(components(cores, 12), foreground, frame.depth)
    return _joined(labels, bend, below, right)


def bends(frame: RGBDFrame, foreground: Mask) -> Array:
    """(H, W) how much the surface bends inwards at each pixel: sagitta over chord, the most of four directions.

    0 where the chord would cross a depth jump: that is no bend of one surface; and far from the foreground.
    """
    middle = float(np.median(frame.depth[foreground])) if foreground.any() else 1.0
    step = int(np.clip(np.rint(REACH * frame.camera.fx / middle), 3, 24))
    rows, columns = window_of(foreground)
    around = tuple(slice(max(0, side.start - 2 * step), side.stop + 2 * step) for side in (rows, columns))
    x, y, z = np.ascontiguousarray(np.moveaxis(frame.points()[around], -1, 0))  # many times as fast as rows of three
    below, right = jumps(frame.depth)
    jump = (below | right | (frame.depth <= 0))[around].astype(np.uint8)
    whole = np.zeros(frame.depth.shape)
    found = whole[around]
    for down, across in DIRECTIONS:
        length = max(2, round(step / float(np.hypot(down, across))))
        smooth = cv2.dilate(jump, _line(down, across, length)) == 0
        before, here, after = _along(jump.shape, down * length, across * length)
        chord = np.sqrt((x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2 + (z[after] - z[before]) ** 2)
        sag = z[here] - (z[before] + z[after]) / 2
        bend = np.where(smooth[here] & (chord < 6 * REACH), sag / np.maximum(chord, 1e-6), 0.0)
        np.maximum(found[here], bend, out=found[here])
    return whole


def _along(shape: tuple[int, ...], down: int, across: int) -> list[tuple[slice, slice]]:
    """The pixels before, at and after each pixel that has others so far ``down`` and ``across`` on both sides."""
    side = abs(across)
    tall, wide = max(0, shape[0] - 2 * down), max(0, shape[1] - 2 * side)
    corners = [(down * (1 + way), side + across * way) for way in (-1, 0, 1)]
    return [np.s_[top : top + tall, left : left + wide] for top, left in corners]


def _line(down: int, across: int, length: int) -> npt.NDArray[np.uint8]:
    """A kernel that is a line through its middle, ``length`` pixels to both sides."""
    kernel = np.zeros((2 * length + 1, 2 * length + 1), np.uint8)
    steps = np.arange(-length, length + 1)
    kernel[length + down * steps, length + across * steps] = 1
    return kernel


def grown(labels: Labels, foreground: Mask, depth: Depth, rounds: int = 14) -> Labels:
    """Give the foreground's other pixels to the segment they touch, step by step and never across a depth jump."""
    below, right = (np.pad(jump, 1) for jump in jumps(depth))
    result, row = np.pad(labels, 1), labels.shape[1] + 2
    empty = np.flatnonzero(np.pad(foreground, 1) & (result == 0))
    ways = ((below, 0, row), (below, -row, -row), (right, 0, 1), (right, -1, -1))
    # Beyond a jump, as beyond the picture, nothing is: pixel 0.
    around = np.stack([np.where(jump.take(empty + edge), 0, empty + step) for jump, edge, step in ways])
    for _ in range(rounds):
        found = result.take(around)
        taken = found[(found > 0).argmax(axis=0), np.arange(len(empty))]
        result.put(empty, taken)
        left = taken == 0
        if left.all():
            break
        empty, around = empty[left], around[:, left]
    return result[1:-1, 1:-1].copy()


def _joined(labels: Labels, bend: Array, below: Mask, right: Mask) -> Labels:
    length, total = borders(labels, np.minimum(bend, JUMP), below, right)
    return joined(labels, length, total, np.ones(length.shape, np.bool_))


def joined(labels: Labels, length: Array, total: Array, allowed: Mask) -> Labels:
    """Join neighbours, the smoothest border first, until every border that is left is a crease or a jump.

    Args:
        labels: (H, W), 0..N.
        length: (N+1, N+1) of the border of every two labels, pixels; see `borders`.
        total: (N+1, N+1) their summed strength.
        allowed: (N+1, N+1) which may be joined at all; what one may be joined with, what it is joined with may too.
    """
    length, total, allowed = length.copy(), total.copy(), allowed.copy()
    owner = np.arange(len(length))
    mean = np.where(allowed & (length >= SHORTEST), total / np.maximum(length, 1), np.inf)
    np.fill_diagonal(mean, np.inf)
    while mean.flat[smoothest := int(mean.argmin())] < CREASE:
        one, other = divmod(smoothest, len(mean))
        owner[owner == other] = one
        for table in (length, total, allowed):
            table[one] += table[other]
            table[:, one] = table[one]
            table[other] = table[:, other] = 0
            table[one, one] = 0
        mean[other] = mean[:, other] = np.inf
        row = np.where(allowed[one] & (length[one] >= SHORTEST), total[one] / np.maximum(length[one], 1), np.inf)
        mean[one] = mean[:, one] = row
    _, numbers = np.unique(owner, return_inverse=True)
    return numbers.astype(np.int32)[labels]


def borders(labels: Labels, strength: Array, below: Mask, right: Mask) -> tuple[Array, Array]:
    """Length (pixels) and summed strength of the border of every two labels, as (N+1, N+1) symmetric tables."""
    count = int(labels.max()) + 1
    length, total = np.zeros((count, count)), np.zeros((count, count))
    views: tuple[tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], Array, Mask], ...] = (
        (labels[:-1], labels[1:], np.maximum(strength[:-1], strength[1:]), below[:-1]),
        (labels[:, :-1], labels[:, 1:], np.maximum(strength[:, :-1], strength[:, 1:]), right[:, :-1]),
    )
    for one, other, strong, jump in views:
        border = (one != other) & (one > 0) & (other > 0)
        index = one[border].astype(np.int64) * count + other[border]
        length += np.bincount(index, minlength=count**2).reshape(count, count)
        weight = np.where(jump, JUMP, strong)[border]
        total += np.bincount(index, weights=weight, minlength=count**2).reshape(count, count)
    return length + length.T, total + total.T
