"""The noise of a depth camera, measured in its photo, and smoothed away where it is more than stages are made for."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import RGBDFrame
from grs_agents.perception.working_resolution import working_size_factor

CONFIG = DEFAULT.noise
NORMAL = 0.6745  # median of the absolute value of a standard normal variable
SECOND_DIFFERENCE = 6**0.5  # standard deviation of a - 2 b + c of three such variables


@dataclass(frozen=True)
class DepthNoise:
    """Noise that differs from pixel to pixel; what a sensor smooths over, or shifts as a whole, is not in it."""

    at_one_metre: float  # standard deviation at 1 m, metres; it grows with the square of the distance

    @property
    def passes(self) -> int:
        """How many medians over 5 x 5 pixels bring it below what the stages are made for."""
        return min(CONFIG.most, round(self.at_one_metre / CONFIG.each))

    def __str__(self) -> str:
        return f"{1000 * self.at_one_metre:.1f} mm at 1 m"


def measure_depth_noise(frame: RGBDFrame) -> DepthNoise:
    """From second differences along rows: they are 0 on planes, and objects' edges are few; some rows of a large photo
    are enough."""
    depth = frame.depth[:: working_size_factor(frame)]
    before, here, after = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
    known = (before > 0) & (here > 0) & (after > 0)
    if not known.any():
        return DepthNoise(0.0)
    bend = np.abs(before - 2 * here + after)[known] / here[known] ** 2
    return DepthNoise(float(np.median(bend)) / NORMAL / SECOND_DIFFERENCE)


def smooth_depth_noise(frame: RGBDFrame, noise: DepthNoise) -> RGBDFrame:
    """The frame with its depth smoothed as much as its noise asks for; of a usual camera the frame itself."""
    if not noise.passes:
        return frame
    depth = frame.depth
    for _ in range(noise.passes):
        depth = np.asarray(cv2.medianBlur(depth, 5), np.float32)
    note = f"the depth's noise is {noise}: it is smoothed, which blurs small objects"
    return replace(frame, depth=depth, notes=(*frame.notes, note))
