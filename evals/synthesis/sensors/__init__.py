"""Noise models of three kinds of depth camera: time of flight, structured light, stereo."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from evals.synthesis.drawing import Floats, PerfectImage
from evals.synthesis.sensors.stereo import stereo_depth
from evals.synthesis.sensors.structured_light import structured_light_depth
from evals.synthesis.sensors.time_of_flight import time_of_flight_depth
from grs_agents.perception.types import Camera

SensorKind = Literal["time_of_flight", "structured_light", "stereo"]
Sensor = Callable[[PerfectImage, Camera, np.random.Generator], Floats]
SENSORS: dict[SensorKind, Sensor] = {
    "time_of_flight": time_of_flight_depth,
    "structured_light": structured_light_depth,
    "stereo": stereo_depth,
}
"""Each takes the perfect picture, the camera and a source of noise, and gives the depth (H, W) in m, 0 = missing."""

__all__ = ["SENSORS", "Sensor", "SensorKind", "stereo_depth", "structured_light_depth", "time_of_flight_depth"]
