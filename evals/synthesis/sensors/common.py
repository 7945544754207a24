"""Common parts of depth noise: noise correlated over a window, edges, and occlusion in a second view."""

import cv2
import numpy as np
import numpy.typing as npt

from evals.synthesis.drawing import Bools, Floats, PerfectImage


def noisy_rgb(rgb: Floats, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """8-bit colours of an (H, W, 3) picture in 0..1: a slight blur, then sensor noise that grows with light."""
    soft = np.asarray(cv2.GaussianBlur(rgb, (0, 0), 0.6), dtype=np.float64)
    noise = rng.normal(size=rgb.shape) * (0.004 + 0.008 * np.sqrt(soft))
    return np.round(np.clip(soft + noise, 0, 1) * 255).astype(np.uint8)


def smooth_noise(shape: tuple[int, int], width: float, rng: np.random.Generator) -> Floats:
    """(H, W) noise of unit deviation, alike over about ``width`` pixels."""
    noise = np.asarray(cv2.GaussianBlur(rng.normal(size=shape), (0, 0), width), np.float64)
    return noise * (2 * np.sqrt(np.pi) * width)


def depth_edges(depth: Floats, step: float) -> Bools:
    """(H, W) pixels with a neighbour that is farther away or nearer by more than ``step`` of their depth."""
    kernel = np.ones((3, 3), np.uint8)
    span = np.asarray(cv2.dilate(depth, kernel)) - np.asarray(cv2.erode(depth, kernel))
    return np.asarray(span > step * depth)


def occluded_from_second_eye(disparity: Floats, slack: float = 1.5) -> Bools:
    """Returns: mask (H, W) of pixels occluded in a second view beside the camera.

    Args:
        disparity: (H, W) shift of each pixel to the left in the second view, columns.
        slack: least difference of the disparity of an occluder, pixels.
    """
    height, width = disparity.shape
    columns = np.arange(width, dtype=np.float64) - disparity
    bins = np.clip(np.rint(columns).astype(np.int64), -width, width - 1) + width
    rows = 2 * width * np.arange(height, dtype=np.int64)[:, None]
    nearest = np.full(height * 2 * width, -np.inf)
    np.maximum.at(nearest, (rows + bins).ravel(), disparity.ravel())
    nearest = nearest.reshape(height, 2 * width).astype(np.float32)
    nearest = np.asarray(cv2.dilate(np.where(np.isfinite(nearest), nearest, 0), np.ones((1, 3), np.uint8)))
    return np.asarray(np.take_along_axis(nearest, bins, axis=1) > disparity + slack)


def returned_light(seen: PerfectImage) -> Floats:
    """Returned share (H, W) of a light beside the camera: 1 from a white wall at 1 m seen frontally.

    A specular object deflects most of it, unless it faces the camera.
    """
    mirrored = np.where(seen.shiny, np.where(seen.cosine > 0.98, 6.0, 0.25), 1.0)
    return seen.albedo * seen.cosine * mirrored / np.maximum(seen.depth, 0.2) ** 2


def frayed_outlines(picture: Floats, deviation: float, width: float, rng: np.random.Generator) -> Floats:
    """The picture (H, W) with frayed outlines: each pixel takes the value ``deviation`` pixels off."""
    rows, columns = np.indices(picture.shape)
    shift = [smooth_noise(picture.shape, width, rng) * deviation for _ in range(2)]
    row = np.clip(np.rint(rows + shift[0]).astype(np.int64), 0, picture.shape[0] - 1)
    column = np.clip(np.rint(columns + shift[1]).astype(np.int64), 0, picture.shape[1] - 1)
    return picture[row, column]


def random_patches(shape: tuple[int, int], share: float | Floats, width: float, rng: np.random.Generator) -> Bools:
    """(H, W) blots of about ``width`` pixels that cover ``share`` (of everything, or at each pixel) of the picture."""
    field = smooth_noise(shape, width, rng)
    return np.asarray((0.5 * (1 + np.tanh(np.sqrt(2 / np.pi) * (field + 0.044715 * field**3)))) > 1 - np.asarray(share))
