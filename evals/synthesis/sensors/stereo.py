"""An active stereo camera of the RealSense D400 kind, with a weak pattern projector.

Sources: Keselman et al., "Intel RealSense stereoscopic depth cameras", CVPR workshops 2017, and Grunnet-Jepsen et al.,
"Best-known-methods for tuning Intel RealSense D400 depth cameras", 2018 (deviation of the disparity of about 0.08
pixels, hence of the depth with the square of the distance; steps of 1/32 pixel); Scharstein and Szeliski, "A taxonomy
and evaluation of dense two-frame stereo correspondence algorithms", IJCV 47, 2002 (outlines fattened by the matching
window, no match in half-occluded and untextured regions); Ahn et al., "Analysis and noise modeling of the Intel
RealSense D435 for mobile robots", UR 2019 (noise that is alike over the window; holes).
"""

import cv2
import numpy as np

from evals.synthesis.drawing import Floats, PerfectImage
from evals.synthesis.sensors.common import (
    depth_edges,
    frayed_outlines,
    occluded_from_second_eye,
    random_patches,
    smooth_noise,
)
from grs_agents.perception.types import Camera

BASELINE = 0.05
STEP = 1 / 32
DEVIATION = 0.08
"""Standard deviation of the disparity on texture, pixels."""
FAT = 2
"""Growth of outlines over a background without texture, pixels."""
NEAREST, FARTHEST = 0.2, 6.0
_WINDOW = 2.5
_TEXTURE = 0.012
"""Contrast within the window (deviation of the brightness) below which a match is doubtful."""


def stereo_depth(seen: PerfectImage, camera: Camera, rng: np.random.Generator) -> Floats:
    """Returns: measured depth (H, W), m; 0 = no measurement."""
    shape = (camera.height, camera.width)
    product = camera.fx * BASELINE
    exact = product / seen.depth
    grey = np.ascontiguousarray(seen.rgb.mean(axis=2))
    mean = np.asarray(cv2.blur(grey, (7, 7)), np.float64)
    square = np.asarray(cv2.blur(grey**2, (7, 7)), np.float64)
    plain = np.clip(1 - np.sqrt(np.maximum(square - mean**2, 0)) / _TEXTURE, 0, 1)
    fat = np.asarray(cv2.dilate(exact, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * FAT + 1, 2 * FAT + 1))))
    matched = np.where(random_patches(shape, 0.3 + 0.6 * plain, 3.0, rng), fat, exact)
    fine, coarse = rng.normal(size=shape), smooth_noise(shape, _WINDOW, rng)
    noise = DEVIATION * (1 + plain) * (0.35 * fine + 0.94 * coarse)
    disparity = frayed_outlines(matched, 0.5, 1.5, rng) + noise
    measured = product / np.maximum(np.rint(disparity / STEP) * STEP, STEP)
    lost = occluded_from_second_eye(exact) | random_patches(shape, 0.004 + 0.05 * plain + 0.15 * seen.shiny, 4.0, rng)
    lost |= depth_edges(seen.depth, 0.03) & (rng.random(shape) < 0.25)
    lost |= (seen.cosine < 0.08) | (measured < NEAREST) | (measured > FARTHEST)
    return np.where(lost, 0.0, measured)
