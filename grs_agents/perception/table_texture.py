"""The photo's table, seen straight from above: the texture of the twin's table top."""

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_bytes
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE

Floats = npt.NDArray[np.float32]
TEXTURE: Final = "table/photo.png"
"""Library name of the texture, among the assets of a run."""
_PIXELS: Final = 1024
"""Of a side: 2.3 mm of table, about what a photo of 640 x 480 pixels resolves at 1.2 m."""
_OFF_PLANE: Final = 0.01
"""Metres above or below the table top at which a pixel still shows the table."""
_MARGIN: Final = 0.012
"""Share of the photo's width around objects and depth edges that shows both surfaces."""
_REACH: Final = 0.25
"""Metres from the seen table within which the texture fades into the table's colour."""
_FEWEST: Final = 2000
"""Pixels of the texture that the photo has to show: 100 cm^2."""
_WHOLE: Final = 255
_NARROW: Final = 9
"""Pixels of the texture: 2 cm."""
_SAMPLED: Final = 20_000
"""Pixels that the median colour is taken of."""
_LEVELS: Final = 7
"""Halvings of half the texture: the coarsest cell is 0.6 m."""


def write_table_texture(frame: RGBDFrame, table: TableFrame, objects: Mask, assets: Path) -> str | None:
    """Rectify the photo onto the table plane and write it as a PNG of 1024 x 1024 pixels below ``assets``.

    The texture covers the whole top of the simulated table: columns along x from its least x on, rows against y from
    its greatest y on. Table that something hides has the colours of the table around; farther away it has the median
    colour of the table that is seen. Shadows stay in it.

    Args:
        frame: the photo.
        table: pose of the table in it.
        objects: (H, W) pixels of objects and of whatever else rises above the table.
        assets: the library folder of the run.

    Returns:
        The library name of the texture; None where the photo shows too little of the table.
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
    seen = (rectify(_mask_table_pixels(frame, pose, objects), cv2.BORDER_CONSTANT) == _WHOLE) & (depth > 0)
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


def _mask_table_pixels(frame: RGBDFrame, pose: Array, objects: Mask) -> npt.NDArray[np.uint8]:
    """(H, W) `_WHOLE` where the photo shows the table and nothing else, 0 elsewhere; ``pose`` is T_robot_cam (4, 4)."""
    camera, depth = frame.camera, frame.depth
    rows, columns = np.ogrid[: depth.shape[0], : depth.shape[1]]
    slope = pose[2, 0] * (columns - camera.cx) / camera.fx + pose[2, 1] * (rows - camera.cy) / camera.fy + pose[2, 2]
    height = depth * slope.astype(np.float32) + np.float32(pose[2, 3])
    hidden = objects | ((np.abs(height) > _OFF_PLANE) & (depth > 0))
    size = 2 * max(1, round(_MARGIN * camera.width)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    shown = (cv2.dilate(hidden.astype(np.uint8), kernel) == 0) & (depth > 0)
    return shown.astype(np.uint8) * np.uint8(_WHOLE)


def _fill_from_around(photo: npt.NDArray[np.uint8], seen: Mask) -> npt.NDArray[np.uint8]:
    """The photo at half its size (H / 2, W / 2, 3), with smooth colours of what is ``seen`` (H, W) around elsewhere.

    Means over ever larger cells are taken from the smallest that holds something (push and pull). With the distance
    from what is seen they give way to the median colour, but not in holes. ``photo`` (H, W, 3) is 0 where not seen.
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
        # A cell counts in full once a quarter of it is seen: what is hidden shows little of what lies farther.
        share = np.minimum(4 * weight, 1)[..., None]
        filled = np.asarray(share * total / np.maximum(weight, 1e-6)[..., None] + (1 - share) * filled, np.float32)
    distance = cv2.distanceTransform((~whole).astype(np.uint8), cv2.DIST_L2, 3) * (2 * TABLE_SIDE / photo.shape[1])
    near = (0.5 + 0.5 * np.cos(np.pi * np.clip(distance / _REACH, 0, 1)))[..., None]
    faded = np.where(_close_holes(whole)[..., None], filled, near * filled + (1 - near) * far)
    return np.clip(np.rint(faded), 0, 255).astype(np.uint8)


def _close_holes(seen: Mask) -> Mask:
    """What is seen, and what of the table things hide: everything that has no way to the border of the texture."""
    outside = np.pad((~seen).astype(np.uint8), 1, constant_values=1)
    cv2.floodFill(outside, None, (0, 0), 2)
    return outside[1:-1, 1:-1] != 2
