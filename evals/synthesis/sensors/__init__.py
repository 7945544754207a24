"""What three kinds of depth camera make of a perfect picture: time of flight, structured light, stereo."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from evals.synthesis.drawing import Floats, Seen
from evals.synthesis.sensors.stereo import stereo
from evals.synthesis.sensors.structured_light import structured_light
from evals.synthesis.sensors.time_of_flight import time_of_flight
from grs_agents.perception import Camera

SensorKind = Literal["time_of_flight", "structured_light", "stereo"]
Sensor = Callable[[Seen, Camera, np.random.Generator], Floats]
SENSORS: dict[SensorKind, Sensor] = {
    "time_of_flight": time_of_flight,
    "structured_light": structured_light,
    "stereo": stereo,
}
"""Each takes the perfect picture, the camera and a source of noise, and gives the depth (H, W) in m, 0 = missing."""

__all__ = ["SENSORS", "Sensor", "SensorKind", "stereo", "structured_light", "time_of_flight"]
