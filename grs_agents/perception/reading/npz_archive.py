"""Reader of a scene in an ``.npz``: rgb, depth and K, and optional arrays."""

from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import read_npz
from grs_agents.base.foreign.pictures import MOST_PIXELS
from grs_agents.perception.reading.camera import camera_from_matrix
from grs_agents.perception.reading.frame_assembly import RecordedDepth, SceneRecording
from grs_agents.perception.reading.picture import ColorPicture

WANTED = {
    "rgb": "(H, W, 3) uint8",
    "depth": "(H, W), metres as floats or integers times depth_scale",
    "K": "3x3, in pixels",
}
OPTIONAL = {
    "depth_scale": "metres per unit of depth",
    "T_robot_cam": "4x4, camera to robot frame, metres",
    "joints": "(N,) positions of the arm's joints, rad, base first",
}


def read_npz_archive(file: Path) -> SceneRecording:
    """Read the arrays rgb, depth and K, and depth_scale, T_robot_cam and joints if present."""
    arrays = read_npz(file, WANTED, OPTIONAL)
    rgb = arrays["rgb"]
    channels = rgb.shape[2] if rgb.ndim == 3 else 1
    if rgb.ndim not in (2, 3) or channels not in (1, 3, 4) or rgb.dtype.name not in ("uint8", "uint16"):
        raise InputError(f"rgb in {file} has shape {rgb.shape} and type {rgb.dtype}", f"give {WANTED['rgb']}")
    if rgb.shape[0] * rgb.shape[1] > MOST_PIXELS:
        remedy = "give it smaller"
        raise InputError(f"rgb in {file} is {rgb.shape[1]}x{rgb.shape[0]}, more than {MOST_PIXELS} pixels", remedy)
    eight = (rgb // 257 if rgb.dtype == np.uint16 else rgb).astype(np.uint8)
    planes = eight.reshape(*eight.shape[:2], channels)
    colors = np.repeat(planes, 3, axis=2) if channels == 1 else planes[..., :3].copy()
    depth, matrix = arrays["depth"], arrays["K"]
    if depth.ndim != 2 or depth.dtype.kind == "b" or depth.dtype.itemsize < 2 or depth.size > MOST_PIXELS:
        raise InputError(f"depth in {file} has shape {depth.shape} and type {depth.dtype}", f"give {WANTED['depth']}")
    if matrix.shape != (3, 3):
        raise InputError(f"K in {file} has shape {matrix.shape}", f"give {WANTED['K']}")
    scale = 1.0
    if (stated := arrays.get("depth_scale")) is not None:
        scale = float(stated.reshape(-1)[0]) if stated.size == 1 else np.nan
        if not (np.isfinite(scale) and scale > 0):
            found = f"depth_scale in {file} is {str(stated.tolist())[:80]}"
            raise InputError(found, "give one number: metres per unit")
    elif depth.dtype.kind != "f":
        remedy = "add depth_scale: 0.001 for millimetres"
        raise InputError(f"depth in {file} is of type {depth.dtype} and there is no depth_scale", remedy)
    more: dict[str, Any] = {"depth_scale": scale}
    more |= {name: arrays[name].tolist() for name in ("T_robot_cam", "joints") if name in arrays}
    camera = camera_from_matrix(matrix.tolist(), (colors.shape[1], colors.shape[0]), f"K in {file}", **more)
    measured = RecordedDepth(depth, scale, f"depth in {file}", f"depth_scale in {file}")
    return SceneRecording(file, ColorPicture(file, colors), camera, measured)
