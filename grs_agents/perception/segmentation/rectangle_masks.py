"""Segmentation of the object in a rectangle that a person draws: by depth, colour, and the objects known around it.

The smooth patches of depth that together fill the rectangle are likely the object. Depth is blurred, misses low and
shiny objects, and joins objects that touch; so superpixels of the photo's colours, cut at the patches' borders, are
assigned to object or background by a minimum cut, as in GrabCut (Rother et al., SIGGRAPH 2004). Several cuts, with
more and less trust in depth and in the known objects, are made; that whose bounding box fits the rectangle best is the
object (cf. Lempitsky et al., "Image segmentation with a bounding box prior", ICCV 2009).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import Labels, grow_window, label_connected_components, mask_bounding_slices
from grs_agents.perception.segmentation.configuration import RectangleMasks
from grs_agents.perception.segmentation.patch_cutting import (
    compute_concavity_map,
    cut_smooth_patches,
    find_depth_jumps,
    foreground_pixel_mask,
    smooth_frame_depth,
)
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Image, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, upscale_labels

csgraph: Any = import_module("scipy.sparse.csgraph")  # has no types
Window = tuple[slice, slice]
Numbers = npt.NDArray[np.int32]
SURE = 1e4
"""Cost of a label that is excluded."""
SCALE = 100.0
"""Integer steps of a cost of 1: the maximum flow is of integers."""


class _Surfaces(NamedTuple):
    """Depth of a photo at its working size, cut into patches."""

    transform: tuple[tuple[float, ...], ...]  # of the table frame
    patches: Labels  # (H, W) smooth surfaces above the table; 0 elsewhere
    borders: tuple[Array, Array]  # (H, W) strength 0..1 of the border to the pixel below, and to the right
    measured: Mask  # (H, W)


_SURFACES: WeakKeyDictionary[RGBDFrame, _Surfaces] = WeakKeyDictionary()  # a person draws many rectangles in a photo


class _Pieces(NamedTuple):
    """Patches of depth cut at the borders of the known objects; arrays are (N + 1,)."""

    labels: Labels  # (H, W), 1..N; 0 elsewhere
    known: Mask  # of a known object that the rectangle is filled without
    reach: Array  # share of the piece inside the rectangle
    chosen: Mask  # together they fill the rectangle
    fit: float  # of their bounding box with the rectangle


@dataclass(frozen=True)
class _Superpixels:
    """Superpixels of a window; arrays are (N,)."""

    window: Window
    labels: Labels  # (h, w), 0..N-1
    counts: Array  # pixels
    outside: Mask  # of the rectangle, or of the object to be split
    ignored: Mask  # outside of the object to be split
    words: Numbers  # cluster of the colour
    pieces: Numbers  # piece of depth
    measured: Array  # share with depth
    edges: tuple[Numbers, Numbers]  # (E,) neighbours, each pair once
    by_color: Array  # (E,) similarity along the common border, summed
    by_depth: Array
    side: float  # of a superpixel


def segment_rectangle(
    frame: RGBDFrame,
    table: TableFrame,
    window: Window,
    others: Sequence[Mask] = (),
    whole: Mask | None = None,
    config: RectangleMasks = DEFAULT.segmentation.rectangles,
) -> Mask | None:
    """(H, W) mask of the object in a rectangle.

    Args:
        frame: the photo.
        table: the table in it.
        window: rows and columns of the rectangle.
        others: (H, W) masks of the known objects; those that the rectangle is filled without are background.
        whole: (H, W) object of which the mask is a part, or None.
        config: constants.

    Returns:
        None if nothing in the rectangle differs from its surroundings.
    """
    small, factor = downscale_frame(frame)
    rows, columns = (slice(side.start // factor, -(-side.stop // factor)) for side in window)
    masks = [downscale_mask(mask, factor) for mask in others]
    domain = None if whole is None else downscale_mask(whole, factor)
    mask = _segment(small.rgb, _find_surfaces(small, table), (rows, columns), masks, domain, config)
    if mask is None or factor == 1:
        return mask
    full = np.asarray(upscale_labels(mask.astype(np.int32), small, frame, factor) > 0, np.bool_)
    return full if whole is None else full & whole  # cells at its border reach beyond it


def _find_surfaces(small: RGBDFrame, table: TableFrame) -> _Surfaces:
    cached = _SURFACES.get(small)
    if cached is not None and cached.transform == table.T_robot_cam:
        return cached
    smooth = smooth_frame_depth(small)
    above = foreground_pixel_mask(robot_frame_point_map(smooth, table), smooth, table.camera_position)
    bend = compute_concavity_map(smooth, above)
    strongest = DEFAULT.segmentation.patches.jump
    strength = np.minimum(bend, strongest) / strongest
    below, right = (jumps.astype(np.float64) for jumps in find_depth_jumps(smooth.depth))
    below[:-1] = np.maximum(below[:-1], np.maximum(strength[:-1], strength[1:]))
    right[:, :-1] = np.maximum(right[:, :-1], np.maximum(strength[:, :-1], strength[:, 1:]))
    patches = cut_smooth_patches(smooth, above, bend)
    _SURFACES[small] = surfaces = _Surfaces(table.T_robot_cam, patches, (below, right), smooth.depth > 0)
    return surfaces


def _segment(
    rgb: Image, surfaces: _Surfaces, box: Window, known: Sequence[Mask], domain: Mask | None, config: RectangleMasks
) -> Mask | None:
    """The mask (H, W) in a photo at its working size."""
    if domain is not None:  # the rectangle around a part may be larger than the object
        box = _intersect(box, mask_bounding_slices(domain))
    if min(_sides(box)) < 2:
        return None
    pieces = _find_pieces(surfaces, box, known, domain, config)
    pixels = _cut_superpixels(rgb, surfaces, box, pieces, domain, config)
    best, most, trusted, excluded = None, 0.0, 0.0, False
    for trust, exclude, bias in _list_cuts(pieces, config):
        mask = _cut(pixels, pieces, trust, exclude, bias, config)
        if mask is None:
            continue
        fit = _intersection_over_union(mask_bounding_slices(mask), _shift(box, pixels.window))
        bolder = trust < trusted or (excluded and not exclude)
        if best is None or fit > most + (config.bold_margin if bolder else config.margin):
            best, most, trusted, excluded = mask, fit, trust, exclude
        if most > config.enough:
            break
    if best is None:
        return None
    whole = np.zeros(surfaces.patches.shape, np.bool_)
    whole[pixels.window] = best
    return whole


def _sides(box: Window) -> tuple[int, int]:
    """Height and width of a window."""
    return box[0].stop - box[0].start, box[1].stop - box[1].start


def _shift(box: Window, origin: Window) -> Window:
    """A window of the picture as a window of its part from the ``origin``."""
    (down, across), (rows, columns) = (side.start for side in origin), box
    return slice(rows.start - down, rows.stop - down), slice(columns.start - across, columns.stop - across)


def _intersect(first: Window, second: Window) -> Window:
    """The common part of two windows, empty if they are apart."""
    starts = [max(a.start, b.start) for a, b in zip(first, second, strict=True)]
    stops = [min(a.stop, b.stop) for a, b in zip(first, second, strict=True)]
    rows, columns = (slice(start, max(start, stop)) for start, stop in zip(starts, stops, strict=True))
    return rows, columns


def _intersection_over_union(first: Window, second: Window) -> float:
    """Shared area of two windows as a share of their union, 0..1."""
    shared, *areas = (int(np.prod(_sides(box))) for box in (_intersect(first, second), first, second))
    return shared / max(sum(areas) - shared, 1)


def _list_cuts(pieces: _Pieces, config: RectangleMasks) -> Iterator[tuple[float, bool, float]]:
    """Trust in depth, exclusion of known objects, and bias to the object, of each cut, the most likely first."""
    trust = float(np.clip((pieces.fit - config.poor) / (config.good - config.poor), 0, 1))
    for exclude in (True, False) if pieces.known.any() else (True,):
        for bias in config.biases:
            yield trust, exclude, bias
            if trust > 0:
                yield 0.0, exclude, bias


def _find_pieces(
    surfaces: _Surfaces, box: Window, known: Sequence[Mask], domain: Mask | None, config: RectangleMasks
) -> _Pieces:
    """The pieces of depth around a rectangle, and those that fill it."""
    window = grow_window(box, round(config.around * max(_sides(box))))
    patches = surfaces.patches[window]
    if domain is not None:
        patches = np.where(domain[window], patches, 0)
    count = int(surfaces.patches.max()) + 1
    patches, owners = patches.copy(), np.zeros(patches.shape, np.int64)
    for owner, mask in enumerate(sorted(known, key=np.count_nonzero, reverse=True), 1):  # the smaller on top
        redrawn = _intersection_over_union(mask_bounding_slices(mask), box) > config.redrawn
        owners[mask[window]] = 0 if redrawn else owner
        if not redrawn and np.count_nonzero(mask[box]) > config.within * np.count_nonzero(mask):
            patches[mask[window]] = 0  # it is a piece as a whole
    keys, places = np.unique(owners * count + patches, return_inverse=True)
    first = int(keys[0] > 0)  # 0 if there are pixels of no piece
    labels = (places.reshape(patches.shape) + first).astype(np.int32)
    owners_of_pieces = np.concatenate([np.zeros(first, np.int64), keys // count])
    owned = owners_of_pieces > 0
    inner = _shift(box, window)
    total = np.bincount(labels.ravel(), minlength=len(owned))
    inside = np.bincount(labels[inner].ravel(), minlength=len(owned))
    reach = inside / np.maximum(total, 1)
    fewest = max(config.fewest, config.least_piece * float(np.prod(_sides(box))))
    usable = np.flatnonzero((reach > config.within) & (inside >= fewest)).tolist()
    numbers, fit = _fill_rectangle([number for number in usable if number], labels, inner, inside, owned, config)
    chosen = np.zeros(len(owned), np.bool_)
    chosen[numbers] = True
    whole = np.zeros(surfaces.patches.shape, np.int32)
    whole[window] = labels
    known_background = owned & ~np.isin(owners_of_pieces, owners_of_pieces[chosen])
    return _Pieces(whole, known_background, reach, chosen, fit)


def _fill_rectangle(
    usable: Sequence[int],
    labels: Labels,
    box: Window,
    inside: npt.NDArray[np.intp],
    owned: Mask,
    config: RectangleMasks,
) -> tuple[list[int], float]:
    """The pieces whose common bounding box fits a rectangle best, and the fit, 0..1.

    Greedy, from the best piece and from all that belong to no known object.

    Args:
        usable: numbers of the pieces that are mostly inside.
        labels: (h, w) numbers of the pieces.
        box: the rectangle.
        inside: (N + 1,) pixels of each piece in the rectangle.
        owned: (N + 1,) pieces of known objects.
        config: constants.
    """
    places = {number: mask_bounding_slices(labels == number) for number in usable}

    def fit(numbers: Sequence[int]) -> float:
        rows, columns = zip(*(places[number] for number in numbers), strict=True)
        around = (
            slice(min(side.start for side in rows), max(side.stop for side in rows)),
            slice(min(side.start for side in columns), max(side.stop for side in columns)),
        )
        return _intersection_over_union(around, box)

    def score(numbers: Sequence[int]) -> float:
        counts = inside[list(numbers)]
        filled = float(counts.sum()) / (config.least_filled * float(np.prod(_sides(box))))
        return fit(numbers) * min(1.0, filled) - config.known * float(counts[owned[list(numbers)]].sum() / counts.sum())

    if not usable:
        return [], 0.0
    best: list[int] = []
    most = -1.0
    for start in ([max(usable, key=lambda number: score([number]))], [n for n in usable if not owned[n]]):
        numbers = start
        while numbers:
            larger = [[*numbers, number] for number in usable if number not in numbers]
            smaller = [[n for n in numbers if n != number] for number in numbers] if len(numbers) > 1 else []
            steps = [(score(step) - config.gain, step) for step in larger] + [(score(step), step) for step in smaller]
            value, step = max(steps, default=(-1.0, numbers), key=lambda it: it[0])
            if value <= score(numbers) + 1e-9:
                break
            numbers = step
        if numbers and score(numbers) > most:
            best, most = numbers, score(numbers)
    return (best, fit(best)) if most > config.poor else ([], 0.0)


def _cut_superpixels(
    rgb: Image, surfaces: _Surfaces, box: Window, pieces: _Pieces, domain: Mask | None, config: RectangleMasks
) -> _Superpixels:
    """Superpixels around a rectangle: a watershed of the colours from a grid, cut at the borders of the pieces."""
    tall, wide = _sides(box)
    window = grow_window(box, max(config.least_rim, round(config.rim * max(tall, wide))))
    side = max(config.least_step, config.step * float(np.sqrt(tall * wide)))
    picture = np.ascontiguousarray(rgb[window])
    lab = cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    lab = np.asarray(cv2.bilateralFilter(lab, 5, 10, 3), np.float32)
    labels = _watershed(lab, side)
    parts = pieces.labels[window]
    _, labels = np.unique(labels.astype(np.int64) * len(pieces.reach) + parts, return_inverse=True)
    labels = labels.reshape(parts.shape).astype(np.int32)
    count = int(labels.max()) + 1
    counts = np.bincount(labels.ravel(), minlength=count).astype(np.float64)

    def mean(picture: npt.NDArray[np.generic]) -> Array:
        return np.bincount(labels.ravel(), weights=picture.ravel().astype(np.float64), minlength=count) / counts

    numbers = np.zeros(count, np.int32)
    numbers[labels.ravel()] = parts.ravel()
    inside = np.zeros(surfaces.patches.shape, np.bool_)
    loose = tuple(
        slice(max(0, side.start - by), side.stop + by)
        for side, by in zip(box, (1 + int(config.slack * tall), 1 + int(config.slack * wide)), strict=True)
    )
    inside[loose] = True
    ignored = np.zeros(count, np.bool_) if domain is None else mean(domain[window]) < 0.5
    colors = np.stack([mean(lab[..., channel]) for channel in range(3)], axis=-1).astype(np.float32)
    cv2.setRNGSeed(0)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 12, 0.5)
    words = min(config.words, count)
    _, clusters, _ = cv2.kmeans(colors, words, np.empty(0, np.int32), stop, 1, cv2.KMEANS_PP_CENTERS)
    below, right = (np.exp(-config.sharp * borders[window]) for borders in surfaces.borders)
    first, second, length, by_depth = _measure_borders(labels, below, right)
    distance = np.linalg.norm(colors[first] - colors[second], axis=-1)
    return _Superpixels(
        window=window,
        labels=labels,
        counts=counts,
        outside=(mean(inside[window]) < 0.5) | ignored,
        ignored=ignored,
        words=np.asarray(clusters, np.int32).ravel(),
        pieces=numbers,
        measured=mean(surfaces.measured[window]),
        edges=(first, second),
        by_color=length * np.exp(-((distance / config.alike) ** 2)),
        by_depth=by_depth,
        side=side,
    )


def _measure_borders(labels: Labels, below: Array, right: Array) -> tuple[Numbers, Numbers, Array, Array]:
    """Neighbours of a label image (h, w), (E,) each, with the length and the summed cost of their border.

    ``below`` and ``right`` are (h, w) costs of a border to the pixel below and to the right.
    """
    count = int(labels.max()) + 1
    keys: list[npt.NDArray[np.int64]] = []
    costs: list[Array] = []
    for here, there, cost in (
        (labels[:-1], labels[1:], below[:-1]),
        (labels[:, :-1], labels[:, 1:], right[:, :-1]),
    ):
        border = here != there
        low, high = np.minimum(here[border], there[border]), np.maximum(here[border], there[border])
        keys.append(low.astype(np.int64) * count + high)
        costs.append(cost[border])
    pairs, places = np.unique(np.concatenate(keys), return_inverse=True)
    summed = np.bincount(places, weights=np.concatenate(costs), minlength=len(pairs))
    length = np.bincount(places, minlength=len(pairs)).astype(np.float64)
    return (pairs // count).astype(np.int32), (pairs % count).astype(np.int32), length, np.asarray(summed, np.float64)


def _watershed(lab: npt.NDArray[np.float32], side: float) -> Labels:
    """(h, w) regions of similar colour, from the smoothest pixel near each point of a grid."""
    height, width, _ = lab.shape
    slope = np.zeros((height, width))
    for channel in range(3):
        for step in ((1, 0), (0, 1)):
            slope += np.asarray(cv2.Sobel(lab[..., channel], cv2.CV_64F, *step), np.float64) ** 2
    seeds = np.zeros((height, width), np.int32)
    grid = [(int(y), int(x)) for y in np.arange(side / 2, height, side) for x in np.arange(side / 2, width, side)]
    for number, (row, column) in enumerate(grid, 1):
        top, left = max(0, row - 1), max(0, column - 1)
        near = slope[top : row + 2, left : column + 2]
        down, across = divmod(int(near.argmin()), near.shape[1])
        seeds[top + down, left + across] = number
    shown = np.clip(lab * (2.5, 1, 1) + (0, 128, 128), 0, 255).astype(np.uint8)
    regions = np.asarray(cv2.watershed(shown, seeds), np.int32)
    lines = regions <= 0
    _, near = cv2.distanceTransformWithLabels(lines.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.asarray(near, np.int32)
    numbers = np.zeros(int(nearest.max()) + 1, np.int32)
    numbers[nearest[~lines]] = regions[~lines]
    return np.asarray(numbers[nearest], np.int32)


def _cut(
    pixels: _Superpixels, pieces: _Pieces, trust: float, exclude: bool, bias: float, config: RectangleMasks
) -> Mask | None:
    """(h, w) object of the minimum cut, with colours learnt in a few rounds; None if nothing is left."""
    number, reach, known = pixels.pieces, pieces.reach[pixels.pieces], pieces.known[pixels.pieces]
    chosen = pieces.chosen[number]
    odds = np.where(chosen, config.chosen * trust, np.where(number > 0, -config.left * trust, 0.0))
    odds -= config.chosen * trust * np.clip((config.within - reach) / 0.3, 0, 1) * ((number > 0) & ~chosen)
    odds -= config.table * max(trust, config.least_table) * pixels.measured * (number == 0)
    if exclude:
        odds -= config.taken * known
    depth = config.least_depth + (1 - config.least_depth) * trust
    weights = config.color_border * pixels.by_color + config.depth_border * depth * pixels.by_depth
    first, second = pixels.edges
    weights = np.where(pixels.ignored[first] | pixels.ignored[second], 0.0, weights)
    counts, rim = pixels.counts * ~pixels.ignored, pixels.outside & ~pixels.ignored

    def color_odds(inner: Array, outer: Array) -> Array:
        words = int(pixels.words.max()) + 1
        shares = [np.bincount(pixels.words, weights=weight, minlength=words) + 1 for weight in (inner, outer)]
        ratio = np.log((shares[0] / shares[0].sum() + 0.002) / (shares[1] / shares[1].sum() + 0.002))
        return np.clip(ratio, -config.most_color, config.most_color)[pixels.words]

    inside = ~pixels.outside & (odds > 0)
    if trust < 0.1 or counts[inside].sum() < 0.1 * counts[~pixels.outside].sum():
        inside = (
            ~pixels.outside & (color_odds(counts * ~pixels.outside, counts * rim) > config.unlike) & ~(exclude & known)
        )
    for _ in range(config.rounds):
        ratio = odds + config.color * color_odds(counts * inside, counts * ~inside) + bias
        costs = np.where(pixels.outside, -SURE, ratio * pixels.counts / pixels.side)
        cut = _minimum_cut(costs, first, second, weights)
        if (cut == inside).all():
            break
        inside = cut
    labels = label_connected_components(inside[pixels.labels].astype(np.uint8), config.smallest)
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    if not areas.any():
        return None
    return (areas >= config.part * areas.max())[labels] & (labels > 0)


def _minimum_cut(gains: Array, first: Numbers, second: Numbers, weights: Array) -> Mask:
    """(N,) nodes on the side of the source.

    Args:
        gains: (N,) of a node on the side of the source.
        first, second: (E,) neighbours.
        weights: (E,) cost of neighbours on different sides.
    """
    count = len(gains)
    nodes, source, sink = np.arange(count, dtype=np.int32), np.full(count, count), np.full(count, count + 1)
    units = np.rint(np.clip(gains, -SURE, SURE) * SCALE).astype(np.int32)
    between = np.rint(weights * SCALE).astype(np.int32)
    rows = np.concatenate([source, nodes, first, second])
    columns = np.concatenate([nodes, sink, second, first])
    values = np.concatenate([np.maximum(units, 0), np.maximum(-units, 0), between, between])
    graph = csr_matrix((values, (rows, columns)), shape=(count + 2, count + 2), dtype=np.int32)
    rest = graph - csgraph.maximum_flow(graph, count, count + 1).flow
    rest.data = np.maximum(rest.data, 0)
    rest.eliminate_zeros()
    reached = np.zeros(count + 2, np.bool_)
    reached[csgraph.breadth_first_order(rest, count, return_predecessors=False)] = True
    return reached[:count]
