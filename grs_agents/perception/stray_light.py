"""The robot's light in the depth of what is beside it: an arm near a time-of-flight camera sends back so much more
light than the table that the part of it that scatters in the lens lifts the table by centimetres.

Source: Mure-Dubois and Hügli, "Real-time scattering compensation for time-of-flight camera", ICVS workshop on camera
calibration methods, 2007: what is scattered is the picture under a wide Gaussian. Its share and width are fitted here.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask

CONFIG = DEFAULT.stray_light
Picture = npt.NDArray[np.float32]


@dataclass(frozen=True)
class StrayLight:
    """How much of its surroundings' light a pixel gets, and from where."""

    share: float
    width: float  # standard deviation of the Gaussian, pixels of the photo
    gain: float  # of the pixels beside the robot: so many more lie in the table's plane without it

    def __str__(self) -> str:
        return f"{self.share:.1%} of the light within {self.width:.0f} pixels"


def measure_stray_light(frame: RGBDFrame, table: TableFrame, arm: Array) -> StrayLight | None:
    """The share and the width with which most of what surrounds the robot lies in the table's plane.

    Args:
        frame: the photo.
        table: the table in it.
        arm: (H, W) the robot's depth as the camera sees it, m, infinite where it is not seen.

    Returns:
        None where no robot is seen, or hardly anything lies better than it was measured.
    """
    small, factor = downscale_frame(frame)
    own = downscale_mask(np.isfinite(arm), factor)
    whole = _fill_with_arm(small.depth, arm[factor // 2 :: factor, factor // 2 :: factor][: len(own), : own.shape[1]])
    away = cv2.distanceTransform((~own).astype(np.uint8), cv2.DIST_L2, 5)
    heights = robot_frame_point_map(small, table)[..., 2]
    near = ~own & (away < CONFIG.near) & (heights > -CONFIG.plane) & (heights < CONFIG.lifted)
    if not own.any() or not near.any():
        return None
    eye = float(np.asarray(table.T_robot_cam)[2, 3])
    light = _returned_light(small.rgb, whole)
    depth, height, own_light = small.depth[near], heights[near], light[near]
    flat = np.count_nonzero(height < CONFIG.plane)
    found: list[StrayLight] = []
    for width in CONFIG.widths:
        around, glow = (picture[near] for picture in _surroundings(whole, light, width))
        for share in CONFIG.shares:
            lower = eye + (height - eye) * _unmixed(depth, own_light, around, glow, share) / depth
            gain = np.count_nonzero(np.abs(lower) < CONFIG.plane) - flat
            found.append(StrayLight(share, width * factor, gain / len(height)))
    best = max(found, key=lambda one: one.gain)
    return best if best.gain > CONFIG.gain else None


def remove_stray_light(frame: RGBDFrame, arm: Array, stray: StrayLight) -> RGBDFrame:
    """The photo with the depth that it would have without stray light, and a note; ``arm`` (H, W) is the robot's depth
    as the camera sees it, m, infinite where it is not seen."""
    whole = _fill_with_arm(frame.depth, arm)
    light = _returned_light(frame.rgb, whole)
    unmixed = _unmixed(frame.depth, light, *_surroundings(whole, light, stray.width), stray.share)
    note = f"light that the robot scatters in the lens lifts what is beside it: {stray} is taken out of the depth"
    return replace(frame, depth=np.where(frame.depth > 0, unmixed, np.float32(0)), notes=(*frame.notes, note))


def _fill_with_arm(depth: Picture, arm: Array) -> Picture:
    """(H, W) the depth, m, and that of the arm where it is too bright to be measured; 0 where neither is known."""
    return np.where((depth <= 0) & np.isfinite(arm), arm, depth).astype(np.float32)


def _returned_light(rgb: npt.NDArray[np.uint8], depth: Picture) -> Picture:
    """(H, W) how much of the sensor's own light comes back: less from what is far or dark, none where no depth is
    known. What is dark in the room's light may be in shadow, or be bright in the sensor's: the root counts."""
    bright = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    light = np.sqrt(np.maximum(bright, CONFIG.darkest)) / np.maximum(depth, CONFIG.nearest) ** 2
    return np.where(depth > 0, light, 0).astype(np.float32)


def _surroundings(depth: Picture, light: Picture, width: float) -> tuple[Picture, Picture]:
    """(H, W) the depth that the light around each pixel has, m, and how much light it is."""
    glow = np.asarray(np.maximum(cv2.GaussianBlur(light, (0, 0), width), 1e-6), np.float32)
    return np.asarray(cv2.GaussianBlur(light * depth, (0, 0), width) / glow, np.float32), glow


def _unmixed(depth: Picture, light: Picture, around: Picture, glow: Picture, share: float) -> Picture:
    """The depth, m, of which a mixture with the depth ``around``, by light, is what was measured."""
    mixed = share * glow / np.maximum(share * glow + light, np.float32(1e-6))
    mixed = np.minimum(mixed, CONFIG.most)
    return np.asarray((depth - mixed * around) / (1 - mixed), np.float32)
