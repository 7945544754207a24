"""Features of a segment: coloured points, extents, and a histogram of tone."""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.image_geometry import grow_window, mask_bounding_slices
from grs_agents.perception.matching.asset_appearance import Floats, Indices
from grs_agents.perception.matching.color_histogram import histograms_from_log_colors, to_log_opponent_colors
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, UprightBox

POINTS = 160  # number of points that are aligned with an asset's surface
PIXELS = 300  # number of pixels whose colours are compared
_COLORS = 400  # number of pixels of the histogram
_STRAY = 3  # percentage of outliers on either side
_RIM = 3  # width of the rim of pixels that mix with the background, left out where enough others remain
_FEWEST_SOLID = 30  # measured pixels inside the rim that are enough without those of the rim


@dataclass(frozen=True)
class SegmentFeatures:
    """Measurements of a segment that are compared with assets."""

    points: Floats  # (N, 3) m, robot frame; at most `POINTS`
    surface: Floats  # (P, 3) m, robot frame; at most `PIXELS`, with a colour each
    log_colors: Floats  # (P, 3) smoothed log opponent colours at ``surface``
    mask: Mask  # (H, W)
    upright: UprightBox  # the measured box
    extents: Array  # (3,) m, of the measured box without outliers
    sharp_log_colors: Array  # (M, 3) log opponent colours of its pixels, not smoothed
    pixels: int  # number of pixels with depth

    def untinted_color_histogram(self, tint: Array) -> Floats:
        """Square roots (B,) of the shares of tones, with the tint (2,) of the light removed."""
        white = self.sharp_log_colors - (0.0, *tint)
        return histograms_from_log_colors(white, np.ones((1, len(white))))[0]


def extract_segment_features(frame: RGBDFrame, table: TableFrame, mask: Mask, upright: UprightBox) -> SegmentFeatures:
    """Extract the features of a segment with this mask (H, W) and measured box."""
    window = grow_window(mask_bounding_slices(mask), _RIM)
    inside, depth, rgb = mask[window], frame.depth[window], frame.rgb[window]
    inner = np.asarray(cv2.erode(inside.astype(np.uint8), np.ones((_RIM, _RIM), np.uint8)), bool)
    inner = inner if inner.sum() > 0.4 * inside.sum() else inside
    colors = rgb[inner][:: max(1, int(inner.sum()) // _COLORS)] / 255
    measured = inside & (depth > 0)
    solid = inner & measured
    rows, columns = np.nonzero(solid if solid.sum() >= _FEWEST_SOLID else measured)
    rows, columns = rows + window[0].start, columns + window[1].start
    count, chosen = len(rows), list[Indices]()
    for most in (POINTS, PIXELS):  # evenly spread, in a random order of which every prefix is spread too
        evenly = np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else rows[:0]
        chosen.append(np.random.default_rng(0).permutation(evenly))
    points, surface = (
        pixels_to_robot_frame(frame, table, rows[some], columns[some]).astype(np.float32) for some in chosen
    )
    # The photo without its finest detail, as `asset_appearance` smooths the colours of an asset.
    blur = max(0.7, frame.camera.width / 900)
    wide = grow_window(window, int(4 * blur) + 2)  # the reach of the blur's kernel
    smooth = cv2.GaussianBlur(frame.rgb[wide].astype(np.float32) / 255, (0, 0), blur)
    smooth_colors = smooth[rows[chosen[1]] - wide[0].start, columns[chosen[1]] - wide[1].start]
    return SegmentFeatures(
        points=points,
        surface=surface,
        log_colors=to_log_opponent_colors(smooth_colors.astype(np.float64)).astype(np.float32),
        mask=mask,
        upright=upright,
        extents=np.minimum(upright.size, _extents_without_outliers(surface, upright)),
        sharp_log_colors=to_log_opponent_colors(colors),
        pixels=int(measured.sum()),
    )


def _extents_without_outliers(surface: Floats, upright: UprightBox) -> Array:
    """Extents (3,), m, of points along the box's axes without outliers, downwards to the bottom of the box."""
    if not len(surface):
        return np.asarray(upright.size)
    cosine, sine = np.cos(upright.yaw), np.sin(upright.yaw)
    offset = surface - np.asarray(upright.center)
    along = np.column_stack([offset @ (cosine, sine, 0), offset @ (-sine, cosine, 0), offset[:, 2]])
    low, high = np.percentile(along, (_STRAY, 100 - _STRAY), axis=0)
    low[2] = -upright.size[2] / 2
    return np.asarray(1.03 * (high - low), np.float64)
