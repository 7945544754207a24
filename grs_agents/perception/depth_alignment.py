"""How far the depth of a photo is shifted against its colour: a wrong registration of both cameras puts each object's
colours on what is beside it, and no later stage can tell."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import RGBDFrame
from grs_agents.perception.working_resolution import downscale_frame

CONFIG = DEFAULT.depth_alignment
Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DepthShift:
    """Where the outlines that the depth shows lie in the colours."""

    columns: int  # pixels of the photo, to the right
    rows: int  # downwards
    gain: float  # 0 to 1: how much better outlines of both agree there than where they are

    @property
    def is_significant(self) -> bool:
        """Whether the depth is shifted by more than cameras that were calibrated are."""
        return self.gain >= CONFIG.gain

    def __str__(self) -> str:
        across = f"{abs(self.columns)} pixels to the {'left' if self.columns > 0 else 'right'}"
        down = f"{abs(self.rows)} {'up' if self.rows > 0 else 'down'}"
        return f"{across} and {down}"


def measure_depth_shift(frame: RGBDFrame) -> DepthShift | None:
    """From the near sides of depth jumps: over all shifts, the one at which the colours change most along them.

    Returns:
        None where the photo shows too few jumps, or the best shift is within what calibrated cameras have.
    """
    small, cell = downscale_frame(frame)
    reach = CONFIG.reach
    rows, columns = np.nonzero(_near_side_jump_mask(small.depth)[reach:-reach, reach:-reach])
    if len(rows) < CONFIG.fewest:
        return None
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), CONFIG.most)).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    change = _color_gradient_magnitude(small.rgb)
    span = range(2 * reach + 1)
    agreement = np.array([[change[rows + down, columns + across].mean() for across in span] for down in span])
    down, across = np.unravel_index(int(agreement.argmax()), agreement.shape)
    shift = int(across) - reach, int(down) - reach
    if np.hypot(*shift) < CONFIG.calibrated:
        return None
    best, chance = float(agreement.max()), float(np.median(agreement))
    gain = (best - float(agreement[reach, reach])) / max(best - chance, 1e-6)
    return DepthShift(shift[0] * cell, shift[1] * cell, min(gain, 1.0))


def describe_depth_shift(frame: RGBDFrame) -> list[str]:
    """A note where depth and colour clearly do not belong together as they lie; else none."""
    shift = measure_depth_shift(frame)
    if shift is None or not shift.is_significant:
        return []
    return [
        f"the depth lies {shift} of where the colours show the same outlines: register the depth to the color camera, "
        "or objects get the colors of what is beside them"
    ]


def _near_side_jump_mask(depth: Array) -> npt.NDArray[np.bool_]:
    """(H, W) pixels on the nearer side of a jump in depth, all around which depth is known."""
    kernel = np.ones((3, 3), np.uint8)
    far = np.asarray(cv2.dilate(depth, kernel), np.float32)
    near = np.asarray(cv2.erode(depth, kernel), np.float32)  # 0 beside a pixel without depth
    return (near > 0) & (far - near > CONFIG.jump * near) & (depth - near <= (far - near) / 3)


def _color_gradient_magnitude(rgb: npt.NDArray[np.uint8]) -> Array:
    """(H, W) how steeply the colours change, 1 where they do as at the photo's strongest edges."""
    lab = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB).astype(np.float32), (0, 0), 1)
    slopes = np.array([cv2.Sobel(lab, cv2.CV_32F, 1, 0), cv2.Sobel(lab, cv2.CV_32F, 0, 1)], np.float32)
    change = np.sqrt((slopes**2).sum(axis=(0, -1)))
    return np.minimum(change / max(float(np.percentile(change, 95)), 1e-6), 1).astype(np.float32)
