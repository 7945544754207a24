"""Appearance of the photo's table: its colour, and a rectified texture for the twin's table top."""

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.files import write_bytes
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, X, Y
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE

Floats = npt.NDArray[np.float32]
TEXTURE: Final = "table/photo.png"
"""Library name of the texture, among the assets of a run."""
_PIXELS: Final = 1024
"""A side of the texture: 2.3 mm of table a pixel, about the resolution of a photo of 640 x 480 pixels at 1.2 m."""
_OFF_PLANE: Final = 0.01
"""Largest distance of table pixels from the table top, m."""
_MARGIN: Final = 0.012
"""Width of the mixed band around objects and depth edges, as a share of the photo's width."""
_REACH: Final = 0.25
"""Distance from the visible table over which the texture fades into the table's colour, m."""
_FEWEST: Final = 2000
"""Least visible pixels of the texture: 100 cm^2."""
_WHOLE: Final = 255
_NARROW: Final = 9
"""Pixels of the texture: 2 cm."""
_SAMPLED: Final = 20_000
"""Sample of pixels for the median colour."""
_FEWEST_COLORS: Final = 50
"""Least pixels in the sample that show the table, for its colour."""
_LEVELS: Final = 7
"""Halvings of half the texture: the coarsest cell is 0.6 m."""


def measure_table_color(frame: RGBDFrame, table: TableFrame) -> Vec3 | None:
    """The median colour (sRGB, 0..1) of the photo's table pixels in the workspace; ``None`` with too few of them.

    Flat objects, shadows and highlights hardly move the median.
    """
    step = max(1, int(np.ceil(np.sqrt(frame.depth.size / _SAMPLED))))
    rows, columns = np.nonzero(frame.depth[::step, ::step] > 0)
    rows, columns = rows * step, columns * step
    x, y, z = pixels_to_robot_frame(frame, table, rows, columns).T
    shown = (np.abs(z) < _OFF_PLANE) & (x > X[0]) & (x < X[1]) & (y > Y[0]) & (y < Y[1])
    if np.count_nonzero(shown) < _FEWEST_COLORS:
        return None
    red, green, blue = np.median(frame.rgb[rows[shown], columns[shown]], axis=0) / 255
    return (round(float(red), 4), round(float(green), 4), round(float(blue), 4))


def write_table_texture(frame: RGBDFrame, table: TableFrame, objects: Mask, assets: Path) -> str | None:
    """Rectify the photo onto the table plane and write it as a PNG of 1024 x 1024 pixels below ``assets``.

    The texture covers the whole top of the simulated table: columns along x from its least x on, rows against y from
    its greatest y on. Hidden table is filled with the colours of the table around it; farther away the texture fades to
    the median colour of the visible table. Shadows remain.

    Args:
        frame: the photo.
        table: pose of the table in it.
        objects: (H, W) pixels of objects and of everything else that rises above the table.
        assets: the library folder of the run.

    Returns:
        The library name of the texture; ``None`` if the photo shows too little of the table.
    """
    side = TABLE_SIDE / _PIXELS
    x, y = TABLE_CENTER[0] - TABLE_SIDE / 2, TABLE_CENTER[1] + TABLE_SIDE / 2
    plane = np.array([[side, 0, x + side / 2], [0, -side, y - side / 2], [0, 0, 0], [0, 0, 1]])  # of texture pixels
    camera, pose = frame.camera, np.asarray(table.T_robot_cam, np.float64)
    lens = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    homography = lens @ np.linalg.inv(pose)[:3] @ plane

    def rectify(image: npt.NDArray[Any], border: int) -> npt.NDArray[Any]:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpPerspective(image, homography, (_PIXELS, _PIXELS), flags=flags, borderMode=border)

    rows, columns = np.ogrid[:_PIXELS, :_PIXELS]
    depth = homography[2, 0] * columns + homography[2, 1] * rows + homography[2, 2]
    # Pixels of the table alone, away from objects and depth edges.
    down, across = np.ogrid[: frame.depth.shape[0], : frame.depth.shape[1]]
    slope = pose[2, 0] * (across - camera.cx) / camera.fx + pose[2, 1] * (down - camera.cy) / camera.fy + pose[2, 2]
    height = frame.depth * slope.astype(np.float32) + np.float32(pose[2, 3])
    hidden = objects | ((np.abs(height) > _OFF_PLANE) & (frame.depth > 0))
    size = 2 * max(1, round(_MARGIN * camera.width)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    shown = (cv2.dilate(hidden.astype(np.uint8), kernel) == 0) & (frame.depth > 0)
    seen = (rectify(shown.astype(np.uint8) * np.uint8(_WHOLE), cv2.BORDER_CONSTANT) == _WHOLE) & (depth > 0)
    # Remove narrow strips: mixed pixels of depth edges that fall into the table plane.
    core = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_NARROW, _NARROW))
    seen = cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_OPEN, core) > 0
    count = np.count_nonzero(seen)
    if count < _FEWEST:
        return None
    density = max(1, round(side * camera.fx / float(np.median(depth[seen]))))
    photo = rectify(cv2.blur(frame.rgb, (density, density)), cv2.BORDER_REPLICATE)
    photo[~seen] = 0
    texture = np.asarray(cv2.resize(_fill_from_around(photo, seen), (_PIXELS, _PIXELS)), np.uint8)
    cv2.copyTo(photo, seen.astype(np.uint8), texture)
    encoded = cv2.imencode(".png", texture[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
    write_bytes(assets / TEXTURE, encoded.tobytes())
    return TEXTURE


def _fill_from_around(photo: npt.NDArray[np.uint8], seen: Mask) -> npt.NDArray[np.uint8]:
    """The photo at half its size (H / 2, W / 2, 3), with unseen pixels filled from the ``seen`` (H, W) around them.

    Push-pull: each pixel takes the mean of the smallest cell of a pyramid with seen pixels. Outside of holes the
    filling fades to the median colour with distance. ``photo`` (H, W, 3) is 0 where not seen.
    """
    half = (photo.shape[1] // 2, photo.shape[0] // 2)
    sums = [cv2.resize(photo, half, interpolation=cv2.INTER_AREA).astype(np.float32)]
    weights = [cv2.resize(seen.astype(np.float32), half, interpolation=cv2.INTER_AREA).astype(np.float32)]
    whole = weights[0] > 0.99
    far = np.median(photo[seen][:: max(1, np.count_nonzero(seen) // _SAMPLED)], axis=0).astype(np.float32)
    for _ in range(_LEVELS):
        sums.append(np.asarray(cv2.pyrDown(sums[-1]), np.float32))
        weights.append(np.asarray(cv2.pyrDown(weights[-1]), np.float32))
    filled: Floats = np.broadcast_to(far, sums[-1].shape).astype(np.float32)
    for total, weight in zip(reversed(sums), reversed(weights), strict=True):
        if filled.shape != total.shape:
            filled = np.asarray(cv2.pyrUp(filled, dstsize=(total.shape[1], total.shape[0])), np.float32)
        # A cell counts in full once a quarter of it is seen.
        share = np.minimum(4 * weight, 1)[..., None]
        filled = np.asarray(share * total / np.maximum(weight, 1e-6)[..., None] + (1 - share) * filled, np.float32)
    # Holes in the seen table, hidden by objects, have no way to the border of the texture.
    outside = np.pad((~whole).astype(np.uint8), 1, constant_values=1)
    cv2.floodFill(outside, None, (0, 0), 2)
    closed = outside[1:-1, 1:-1] != 2
    distance = cv2.distanceTransform((~whole).astype(np.uint8), cv2.DIST_L2, 3) * (2 * TABLE_SIDE / photo.shape[1])
    near = (0.5 + 0.5 * np.cos(np.pi * np.clip(distance / _REACH, 0, 1)))[..., None]
    faded = np.where(closed[..., None], filled, near * filled + (1 - near) * far)
    return np.clip(np.rint(faded), 0, 255).astype(np.uint8)
