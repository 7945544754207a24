"""What the camera saw of one candidate: coloured points, their extents, and a histogram of tone."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.correspondence.tone import tone, tone_histograms
from grs_agents.scene import Mask, RGBDFrame, TableFrame, UprightBox
from grs_agents.scene.frame import Array
from grs_agents.scene.table import robot_points_at

POINTS = 160
"""So many points are laid on an asset's surface."""
_COLORS = 800
_RIM = 3
"""Pixels at the outline are a mixture with what is behind; they are left out where enough others remain."""


@dataclass(frozen=True)
class View:
    """The photo as all candidates share it.

    Attributes:
        frame, table: the photo and its pose.
        tones: (H, W, 3) of the photo without its finest detail; see `grs_agents.correspondence.tone`.
    """

    frame: RGBDFrame
    table: TableFrame
    tones: npt.NDArray[np.float32]

    @property
    def eye(self) -> Array:
        """Where the camera is, (3,) m, robot frame."""
        return np.asarray(self.table.T_robot_cam)[:3, 3]


@dataclass(frozen=True)
class Observation:
    """What the camera saw of one candidate.

    Attributes:
        points: (N, 3) m, robot frame; at most `POINTS` of them.
        mask: (H, W) its pixels.
        upright: the box measured of it.
        told: (M, 3) tones of its pixels.
        pixels: how many have a depth.
    """

    points: Array
    mask: Mask
    upright: UprightBox
    told: Array
    pixels: int

    def histogram(self, tint: Array) -> npt.NDArray[np.float32]:
        """(B,) square roots of the shares of tones, once the tint (2,) of the light is taken out."""
        white = self.told - (0.0, *tint)
        return tone_histograms(white, np.ones((1, len(white))))[0]


def view_of(frame: RGBDFrame, table: TableFrame) -> View:
    """Prepare a photo."""
    smooth = cv2.GaussianBlur(frame.rgb.astype(np.float32) / 255, (0, 0), max(0.7, frame.camera.width / 900))
    tones = tone(np.asarray(smooth, np.float64).reshape(-1, 3)).astype(np.float32)
    return View(frame, table, tones.reshape(*frame.depth.shape, 3))


def observe(view: View, mask: Mask, upright: UprightBox) -> Observation:
    """Take a candidate's pixels out of the photo."""
    inner = np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((_RIM, _RIM), np.uint8)), bool)
    inner = inner if inner.sum() > 0.4 * mask.sum() else mask
    colors = view.frame.rgb[inner][:: max(1, int(inner.sum()) // _COLORS)] / 255
    solid = inner & (view.frame.depth > 0)
    rows, columns = np.nonzero(solid if solid.sum() >= 30 else mask & (view.frame.depth > 0))
    step = max(1, len(rows) // POINTS)
    points = robot_points_at(view.frame, view.table, rows[::step][:POINTS], columns[::step][:POINTS])
    return Observation(points, mask, upright, tone(colors), int((mask & (view.frame.depth > 0)).sum()))
