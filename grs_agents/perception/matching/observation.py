"""What the camera saw of one candidate: coloured points, their extents, and a histogram of tone."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.image_geometry import grow_window, mask_bounding_slices
from grs_agents.perception.matching.asset_appearance import Floats, Indices
from grs_agents.perception.matching.color_histogram import histograms_from_log_colors, to_log_opponent_colors
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame, UprightBox

POINTS = 160  # so many points are laid on an asset's surface
PIXELS = 300  # so many pixels are compared in colour
_COLORS = 400
_STRAY = 3  # so many per cent of the pixels on either side may be stray
_RIM = 3  # pixels at the outline are a mixture with what is behind; they are left out where enough others remain


@dataclass(frozen=True)
class View:
    """The photo as all candidates share it."""

    frame: RGBDFrame  # frame, table: the photo and its pose
    table: TableFrame

    @property
    def camera_position(self) -> Array:
        """Where the camera is, (3,) m, robot frame."""
        return np.asarray(self.table.T_robot_cam)[:3, 3]

    def project_points(self, placed: Floats) -> tuple[Indices, Indices, Floats, npt.NDArray[np.bool_]]:
        """Where points (K, N, 3) (m, robot frame) are in the picture: rows, columns, depth (m), and whether inside."""
        camera, pose = self.frame.camera, np.asarray(self.table.T_robot_cam, np.float32)
        local = (placed - pose[:3, 3]) @ pose[:3, :3]
        depth = np.maximum(local[..., 2], np.float32(1e-3))
        columns = np.rint(local[..., 0] / depth * np.float32(camera.fx) + np.float32(camera.cx)).astype(np.int64)
        rows = np.rint(local[..., 1] / depth * np.float32(camera.fy) + np.float32(camera.cy)).astype(np.int64)
        height, width = self.frame.depth.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        return np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1), depth, inside


@dataclass(frozen=True)
class Observation:
    """What the camera saw of one candidate."""

    points: Floats  # (N, 3) m, robot frame; at most `POINTS` of them
    surface: Floats  # (P, 3) m, robot frame; at most `PIXELS` of them, whose tones are
    log_colors: Floats  # (P, 3)
    mask: Mask  # (H, W) its pixels
    upright: UprightBox  # the box measured of it
    extents: Array  # (3,) m, what of that box most of its pixels fill, so that a few stray ones do not make it large
    sharp_log_colors: Array  # (M, 3) tones of its pixels, sharp
    pixels: int  # how many have a depth

    def untinted_color_histogram(self, tint: Array) -> Floats:
        """(B,) square roots of the shares of tones, once the tint (2,) of the light is taken out."""
        white = self.sharp_log_colors - (0.0, *tint)
        return histograms_from_log_colors(white, np.ones((1, len(white))))[0]


def observe_candidate(view: View, mask: Mask, upright: UprightBox) -> Observation:
    """Take a candidate's pixels out of the photo."""
    frame, window = view.frame, grow_window(mask_bounding_slices(mask), _RIM)
    own, depth, rgb = mask[window], frame.depth[window], frame.rgb[window]
    inner = np.asarray(cv2.erode(own.astype(np.uint8), np.ones((_RIM, _RIM), np.uint8)), bool)
    inner = inner if inner.sum() > 0.4 * own.sum() else own
    colors = rgb[inner][:: max(1, int(inner.sum()) // _COLORS)] / 255
    measured = own & (depth > 0)
    solid = inner & measured
    rows, columns = np.nonzero(solid if solid.sum() >= 30 else measured)
    rows, columns = rows + window[0].start, columns + window[1].start
    chosen = [_evenly_spread_indices(len(rows), count) for count in (POINTS, PIXELS)]
    points, surface = (
        pixels_to_robot_frame(frame, view.table, rows[some], columns[some]).astype(np.float32) for some in chosen
    )
    log_colors = _smooth_log_colors(frame, window, rows[chosen[1]], columns[chosen[1]])
    extents = np.minimum(upright.size, _extents_without_outliers(surface, upright))
    tones = to_log_opponent_colors(colors)
    return Observation(points, surface, log_colors, mask, upright, extents, tones, int(measured.sum()))


def _smooth_log_colors(frame: RGBDFrame, window: tuple[slice, slice], rows: Indices, columns: Indices) -> Floats:
    """(N, 3) tones at pixels of a window, of the photo without its finest detail (`color_histogram`)."""
    blur = max(0.7, frame.camera.width / 900)
    wide = grow_window(window, int(4 * blur) + 2)  # as far as the blur's kernel reaches
    smooth = cv2.GaussianBlur(frame.rgb[wide].astype(np.float32) / 255, (0, 0), blur)
    tones = smooth[rows - wide[0].start, columns - wide[1].start]
    return to_log_opponent_colors(tones.astype(np.float64)).astype(np.float32)


def _extents_without_outliers(surface: Floats, upright: UprightBox) -> Array:
    """(3,) m, the extents along the box's axes of all but the outermost; downwards to where the box ends."""
    if not len(surface):
        return np.asarray(upright.size)
    cosine, sine = np.cos(upright.yaw), np.sin(upright.yaw)
    offset = surface - np.asarray(upright.center)
    along = np.column_stack([offset @ (cosine, sine, 0), offset @ (-sine, cosine, 0), offset[:, 2]])
    low, high = np.percentile(along, (_STRAY, 100 - _STRAY), axis=0)
    low[2] = -upright.size[2] / 2
    return np.asarray(1.03 * (high - low), np.float64)


def _evenly_spread_indices(count: int, most: int) -> Indices:
    """At most so many of ``count`` numbers, evenly; in an order of which every beginning is spread too."""
    chosen = np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
    return np.random.default_rng(0).permutation(chosen)
