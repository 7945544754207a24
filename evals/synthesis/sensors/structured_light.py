"""A structured-light camera of the first Kinect's kind.

Sources: Khoshelham and Oude Elberink, "Accuracy and resolution of Kinect depth data for indoor mapping applications",
Sensors 12, 2012 (disparity noise of half a step of 1/8 pixel, hence a deviation of 1.4 mm times the square of the
distance in m, and depth that comes in steps); Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D
reconstruction and tracking", 3DIMPVT 2012 (lateral noise of 0.8 pixels; axial noise that grows at grazing angles);
Mallick, Das and Majumdar, "Characterizations of noise in Kinect depth images", IEEE Sensors Journal 14, 2014 (shadow
beside what is nearer, nothing measured on dark, mirroring and grazing surfaces and along outlines).
"""

import numpy as np

from evals.synthesis.drawing import Floats, PerfectImage
from evals.synthesis.sensors.common import (
    depth_edges,
    frayed_outlines,
    occluded_from_second_eye,
    random_patches,
    returned_light,
    smooth_noise,
)
from grs_agents.perception.types import Camera

BASELINE = 0.075
STEP = 1 / 8
"""Quantisation of the disparity, pixels."""
DEVIATION = STEP / 2
LATERAL = 0.8
NEAREST, FARTHEST = 0.4, 4.0
_WINDOW = 1.5
"""The pattern is matched over a window of 9 pixels: noise is alike over about this many."""
_FAINT = 0.025
_GRAZING = 0.12


def structured_light_depth(seen: PerfectImage, camera: Camera, rng: np.random.Generator) -> Floats:
    """Returns: measured depth (H, W), m; 0 = no measurement."""
    shape = (camera.height, camera.width)
    product = camera.fx * BASELINE
    depth = frayed_outlines(seen.depth, LATERAL, _WINDOW, rng)
    fine, coarse = rng.normal(size=shape), smooth_noise(shape, _WINDOW, rng)
    angle = np.arccos(np.clip(seen.cosine, 0, 1))
    beyond = np.minimum(1e-4 / np.sqrt(seen.depth) * angle**2 / np.maximum(np.pi / 2 - angle, 0.05) ** 2, 0.02)
    disparity = product / depth + DEVIATION * (0.6 * fine + 0.8 * coarse) + (beyond * product / seen.depth**2) * coarse
    measured = product / np.maximum(np.rint(disparity / STEP) * STEP, STEP)
    light = returned_light(seen) * np.exp(0.3 * smooth_noise(shape, _WINDOW, rng))
    lost = occluded_from_second_eye(product / seen.depth) | (light < _FAINT) | (seen.cosine < _GRAZING)
    lost |= seen.shiny & ((seen.cosine > 0.985) | random_patches(shape, 0.2, 4.0, rng))
    lost |= depth_edges(seen.depth, 0.02) & (rng.random(shape) < 0.5)
    lost |= (measured < NEAREST) | (measured > FARTHEST)
    return np.where(lost, 0.0, measured)
