"""A time-of-flight camera of the kind of the second and the Azure Kinect.

Sources: Tölgyessy, Dekan, Chovanec and Hubinský, "Evaluation of the Azure Kinect and its comparison to Kinect V1 and
Kinect V2", Sensors 21, 2021 (deviation of about 1 mm at 1 m, more on dark and far surfaces; flying pixels; nothing
measured where too little or too much light returns); Sarbolandi, Lefloch and Kolb, "Kinect range sensing:
structured-light versus time-of-flight Kinect", CVIU 139, 2015 (cyclic error, dependence on brightness, light from
other paths and scattered in the lens); Fankhauser et al., "Kinect v2 for mobile robot navigation", ICAR 2015 (noise
over distance and incidence).
"""

import cv2
import numpy as np

from evals.synthesis.drawing import Floats, PerfectImage
from evals.synthesis.sensors.common import depth_edges, returned_light
from grs_agents.perception.types import Camera

DEVIATION = 0.001
"""Deviation of the distance to a grey surface (albedo 0.5) at 1 m, metres; inversely proportional to the root of the
light."""
CYCLE, WAVE = 0.0015, 0.30
"""Height (m) of the cyclic error, and the distance (m) after which it repeats."""
STRAY = 0.012
"""Share of the light at a pixel that comes from its surroundings, by other paths or scattered in the lens."""
_AROUND = 14.0
_BLUR = 0.55
"""Radius in which a pixel collects light, pixels: at an outline it mixes two depths."""
_KEPT_FLYING = 0.35
_FAINT, _GLARE = 0.02, 2.5
NEAREST, FARTHEST = 0.25, 5.0


def time_of_flight_depth(seen: PerfectImage, camera: Camera, rng: np.random.Generator) -> Floats:
    """Returns: measured depth (H, W), m; 0 = no measurement."""
    shape = (camera.height, camera.width)
    light = returned_light(seen)
    weight = np.maximum(light, 1e-4)
    mixed = _blurred(weight * seen.depth, _BLUR) / _blurred(weight, _BLUR)
    around, glow = _blurred(weight * seen.depth, _AROUND), _blurred(weight, _AROUND)
    stray = STRAY * glow / (STRAY * glow + weight)
    mixed = mixed + stray * (around / glow - mixed)
    cyclic = CYCLE * np.sin(2 * np.pi * mixed / WAVE + float(rng.uniform(0, 2 * np.pi)))
    deviation = DEVIATION / np.sqrt(np.maximum(light, _FAINT / 2) / 0.5)
    measured = mixed + cyclic + deviation * rng.normal(size=shape)
    faint = light * np.exp(0.2 * rng.normal(size=shape)) < _FAINT
    flying = depth_edges(seen.depth, 0.03) & (rng.random(shape) > _KEPT_FLYING)
    lost = faint | flying | (light > _GLARE) | (measured < NEAREST) | (measured > FARTHEST)
    return np.where(lost, 0.0, measured)


def _blurred(picture: Floats, width: float) -> Floats:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), width), np.float64)
