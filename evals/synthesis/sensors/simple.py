"""What a stereo camera makes of a perfect picture: noise, quantised depth, holes at edges."""

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
_BASELINE = 0.055
_SUBPIXEL = 16
MILLIMETRE = 0.001


def noisy_rgb(rgb: Floats, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """8-bit colours of an (H, W, 3) picture in 0..1: a slight blur, then sensor noise that grows with light."""
    soft = np.asarray(cv2.GaussianBlur(rgb, (0, 0), 0.6), dtype=np.float64)
    noise = rng.normal(size=rgb.shape) * (0.004 + 0.008 * np.sqrt(soft))
    return np.round(np.clip(soft + noise, 0, 1) * 255).astype(np.uint8)


def stereo_depth(depth: Floats, focal: float, rng: np.random.Generator) -> npt.NDArray[np.uint16]:
    """Millimetres (0: no measurement) that a stereo pair would give for an (H, W) depth in m.

    The disparity carries smooth and pixel noise and is rounded to 1/16 px; pixels at depth edges, more on the
    side that only one of the two cameras sees, and a few patches elsewhere are lost.

    Args:
        depth: along the optical axis, m.
        focal: px.
        rng: source of the noise.
    """
    smooth = np.asarray(cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 2.0), dtype=np.float64)
    disparity = focal * _BASELINE / depth + 0.35 * smooth + rng.normal(scale=0.02, size=depth.shape)
    quantised = np.round(disparity * _SUBPIXEL) / _SUBPIXEL
    measured = focal * _BASELINE / np.maximum(quantised, 1.0)
    lost = _edges(depth, rng) | _patches(depth.shape, rng)
    return np.where(lost, 0, np.round(measured / MILLIMETRE)).astype(np.uint16)


def _edges(depth: Floats, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    kernel = np.ones((3, 3), np.uint8)
    step = np.asarray(cv2.dilate(depth, kernel)) - np.asarray(cv2.erode(depth, kernel)) > 0.02
    half_seen = np.zeros_like(step)
    for shift in range(1, 5):
        half_seen[:, :-shift] |= step[:, shift:]
    chance = np.where(step, 0.75, np.where(half_seen, 0.35, 0.0))
    return rng.random(depth.shape) < chance


def _patches(shape: tuple[int, ...], rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    field = np.asarray(cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 2.5))
    return field > 2.9 * field.std()
