"""Faults of measured depth: noise, a shift against the colours, and stray light of the robot.

Noise beyond that of a usual camera is smoothed. A wrong registration of both cameras, which puts each object's colours
on its surroundings, is undone as far as a shift can. Stray light is removed: an arm near a time-of-flight camera
returns so much more light than the table that its part that scatters in the lens lifts the table by centimetres.

Stray light: Mure-Dubois and Hügli, "Real-time scattering compensation for time-of-flight camera", ICVS workshop on
camera calibration methods, 2007. The scattered light is the picture under a wide Gaussian, whose share and width are
fitted here.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, working_size_factor

NOISE = DEFAULT.noise
ALIGNMENT = DEFAULT.depth_alignment
STRAY_LIGHT = DEFAULT.stray_light
Picture = npt.NDArray[np.float32]
NORMAL = 0.6745  # median of the absolute value of a standard normal variable
SECOND_DIFFERENCE = 6**0.5  # standard deviation of a - 2 b + c of three such variables


@dataclass(frozen=True)
class DepthNoise:
    """Noise that is independent from pixel to pixel."""

    at_one_metre: float  # standard deviation at 1 m, metres; it grows with the square of the distance

    @property
    def passes(self) -> int:
        """Number of medians over 5 x 5 pixels that reduce it to that of a usual camera."""
        return min(NOISE.most, round(self.at_one_metre / NOISE.each))

    def __str__(self) -> str:
        return f"{1000 * self.at_one_metre:.1f} mm at 1 m"


def measure_depth_noise(frame: RGBDFrame) -> DepthNoise:
    """Noise by second differences along rows, which are 0 on planes; large photos are subsampled."""
    depth = frame.depth[:: working_size_factor(frame)]
    before, here, after = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
    known = (before > 0) & (here > 0) & (after > 0)
    if not known.any():
        return DepthNoise(0.0)
    bend = np.abs(before - 2 * here + after)[known] / here[known] ** 2
    return DepthNoise(float(np.median(bend)) / NORMAL / SECOND_DIFFERENCE)


def smooth_depth_noise(frame: RGBDFrame, noise: DepthNoise) -> RGBDFrame:
    """The frame with its depth smoothed by its noise; unchanged for a usual camera."""
    if not noise.passes:
        return frame
    depth = frame.depth
    for _ in range(noise.passes):
        depth = np.asarray(cv2.medianBlur(depth, 5), np.float32)
    note = f"the depth's noise is {noise}: it is smoothed, which blurs small objects"
    return replace(frame, depth=depth, notes=(*frame.notes, note))


@dataclass(frozen=True)
class DepthShift:
    """Offset from the outlines in depth to the same outlines in colour."""

    columns: int  # pixels of the photo, to the right
    rows: int  # downwards
    gain: float  # 0 to 1: better agreement of both outlines at that shift

    @property
    def is_significant(self) -> bool:
        """Whether the shift exceeds that of calibrated cameras."""
        return self.gain >= ALIGNMENT.gain

    def __str__(self) -> str:
        across = f"{abs(self.columns)} pixels to the {'left' if self.columns > 0 else 'right'}"
        down = f"{abs(self.rows)} {'up' if self.rows > 0 else 'down'}"
        return f"{across} and {down}"


def measure_depth_shift(frame: RGBDFrame) -> DepthShift | None:
    """The shift with the steepest mean colour gradient along the near sides of depth jumps.

    Returns: ``None`` with too few jumps, or for a shift within that of calibrated cameras.
    """
    small, cell = downscale_frame(frame)
    reach = ALIGNMENT.reach
    kernel = np.ones((3, 3), np.uint8)
    far = np.asarray(cv2.dilate(small.depth, kernel), np.float32)
    near = np.asarray(cv2.erode(small.depth, kernel), np.float32)  # 0 beside a pixel without depth
    jumps = (near > 0) & (far - near > ALIGNMENT.jump * near) & (small.depth - near <= (far - near) / 3)
    rows, columns = np.nonzero(jumps[reach:-reach, reach:-reach])
    if len(rows) < ALIGNMENT.fewest:
        return None
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), ALIGNMENT.most)).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    # Colour gradient, saturated at the photo's strongest edges.
    lab = cv2.GaussianBlur(cv2.cvtColor(small.rgb, cv2.COLOR_RGB2LAB).astype(np.float32), (0, 0), 1)
    slopes = np.array([cv2.Sobel(lab, cv2.CV_32F, 1, 0), cv2.Sobel(lab, cv2.CV_32F, 0, 1)], np.float32)
    gradient = np.sqrt((slopes**2).sum(axis=(0, -1)))
    gradient = np.minimum(gradient / max(float(np.percentile(gradient, 95)), 1e-6), 1).astype(np.float32)
    span = range(2 * reach + 1)
    agreement = np.array([[gradient[rows + down, columns + across].mean() for across in span] for down in span])
    down, across = np.unravel_index(int(agreement.argmax()), agreement.shape)
    shift = int(across) - reach, int(down) - reach
    if np.hypot(*shift) < ALIGNMENT.calibrated:
        return None
    best, chance = float(agreement.max()), float(np.median(agreement))
    gain = (best - float(agreement[reach, reach])) / max(best - chance, 1e-6)
    return DepthShift(shift[0] * cell, shift[1] * cell, min(gain, 1.0))


def align_depth_with_colors(frame: RGBDFrame) -> RGBDFrame:
    """The frame with its depth moved onto the outlines in colour, and a note; unchanged without a significant shift."""
    shift = measure_depth_shift(frame)
    if shift is None or not shift.is_significant:
        return frame
    offset = np.array([[1, 0, shift.columns], [0, 1, shift.rows]], np.float32)
    depth = cv2.warpAffine(frame.depth, offset, frame.depth.shape[::-1], flags=cv2.INTER_NEAREST)
    note = (
        f"the depth lay {shift} of where the colours show the same outlines, and is moved by as much: register the "
        "depth to the color camera"
    )
    return replace(frame, depth=np.asarray(depth, np.float32), notes=(*frame.notes, note))


@dataclass(frozen=True)
class StrayLight:
    """Share and width of the light that a pixel receives from its surroundings."""

    share: float
    width: float  # standard deviation of the Gaussian, pixels of the photo
    gain: float  # share of the pixels beside the robot that come to lie in the table plane without it

    def __str__(self) -> str:
        return f"{self.share:.1%} of the light within {self.width:.0f} pixels"


def measure_stray_light(frame: RGBDFrame, table: TableFrame, arm: Array) -> StrayLight | None:
    """The share and width of stray light that bring most of the robot's surroundings into the table plane.

    Args:
        frame: the photo.
        table: the table in it.
        arm: (H, W) depth of the robot as the camera sees it, m, infinite beside it.

    Returns: ``None`` without a robot in view, or without a clear gain.
    """
    small, factor = downscale_frame(frame)
    robot = downscale_mask(np.isfinite(arm), factor)
    whole = _fill_with_arm(
        small.depth, arm[factor // 2 :: factor, factor // 2 :: factor][: len(robot), : robot.shape[1]]
    )
    away = cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5)
    heights = robot_frame_point_map(small, table)[..., 2]
    near = ~robot & (away < STRAY_LIGHT.near) & (heights > -STRAY_LIGHT.plane) & (heights < STRAY_LIGHT.lifted)
    if not robot.any() or not near.any():
        return None
    eye = float(np.asarray(table.T_robot_cam)[2, 3])
    light = _returned_light(small.rgb, whole)
    depth, height, returned = small.depth[near], heights[near], light[near]
    flat = np.count_nonzero(height < STRAY_LIGHT.plane)
    fits: list[StrayLight] = []
    for width in STRAY_LIGHT.widths:
        around, glow = (picture[near] for picture in _surroundings(whole, light, width))
        for share in STRAY_LIGHT.shares:
            lower = eye + (height - eye) * _unmixed(depth, returned, around, glow, share) / depth
            gain = np.count_nonzero(np.abs(lower) < STRAY_LIGHT.plane) - flat
            fits.append(StrayLight(share, width * factor, gain / len(height)))
    best = max(fits, key=lambda fit: fit.gain)
    return best if best.gain > STRAY_LIGHT.gain else None


def remove_stray_light(frame: RGBDFrame, arm: Array, stray: StrayLight) -> RGBDFrame:
    """The photo with stray light removed from its depth, and a note; ``arm`` as in `measure_stray_light`."""
    whole = _fill_with_arm(frame.depth, arm)
    light = _returned_light(frame.rgb, whole)
    unmixed = _unmixed(frame.depth, light, *_surroundings(whole, light, stray.width), stray.share)
    note = f"light that the robot scatters in the lens lifts what is beside it: {stray} is taken out of the depth"
    return replace(frame, depth=np.where(frame.depth > 0, unmixed, np.float32(0)), notes=(*frame.notes, note))


def _fill_with_arm(depth: Picture, arm: Array) -> Picture:
    """(H, W) depth, m, with that of the arm where it is too bright to be measured; 0 if unknown."""
    return np.where((depth <= 0) & np.isfinite(arm), arm, depth).astype(np.float32)


def _returned_light(rgb: npt.NDArray[np.uint8], depth: Picture) -> Picture:
    """(H, W) returned light of the sensor: less from far or dark surfaces, none without depth. By the root of
    brightness, since dark surfaces may be in shadow, or bright in the sensor's light."""
    bright = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    light = np.sqrt(np.maximum(bright, STRAY_LIGHT.darkest)) / np.maximum(depth, STRAY_LIGHT.nearest) ** 2
    return np.where(depth > 0, light, 0).astype(np.float32)


def _surroundings(depth: Picture, light: Picture, width: float) -> tuple[Picture, Picture]:
    """(H, W) mean depth of the light around each pixel, m, and its amount."""
    glow = np.asarray(np.maximum(cv2.GaussianBlur(light, (0, 0), width), 1e-6), np.float32)
    return np.asarray(cv2.GaussianBlur(light * depth, (0, 0), width) / glow, np.float32), glow


def _unmixed(depth: Picture, light: Picture, around: Picture, glow: Picture, share: float) -> Picture:
    """Depth, m, before its mixture with the depth ``around``, weighted by light."""
    mixed = share * glow / np.maximum(share * glow + light, np.float32(1e-6))
    mixed = np.minimum(mixed, STRAY_LIGHT.most)
    return np.asarray((depth - mixed * around) / (1 - mixed), np.float32)
