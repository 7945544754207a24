"""Cameras under CLIPort's configuration: a dictionary of image size, intrinsics, position and rotation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.engine import mujoco
from grs_agents.geometry import transforms
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.world import rendering
from grs_agents.sim.world.rendering import FRONT, LEFT, RIGHT, View

FloatArray = npt.NDArray[np.float64]
CameraConfig = dict[str, Any]


def config_of(view: View) -> CameraConfig:
    """A view as CLIPort configures it; the camera looks along its own z axis, x to the right, y down."""
    forward = np.subtract(view.target, view.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    matrix, rotation = np.column_stack([right, np.cross(forward, right), forward]), np.empty(4)
    mujoco.mju_mat2Quat(rotation, matrix.ravel())
    focal = float(view.height / 2 / np.tan(np.deg2rad(view.field_of_view) / 2))
    return {
        "image_size": (view.height, view.width),
        "intrinsics": (focal, 0.0, view.width / 2, 0.0, focal, view.height / 2, 0.0, 0.0, 1.0),
        "position": view.position,
        "rotation": transforms.quat(rotation[[1, 2, 3, 0]]),
        "zrange": (0.01, 10.0),
        "noise": False,
    }


AGENT_CAMERAS: tuple[CameraConfig, ...] = tuple(config_of(view) for view in (FRONT, LEFT, RIGHT))


def photograph(sight: rendering.Sight, config: Mapping[str, Any]) -> rendering.Picture:
    """What a configured camera sees.

    Raises:
        SimulationError: the configuration lacks an entry or does not fit.
    """
    try:
        height, width = (int(count) for count in config["image_size"])
        fx, _, cx, _, fy, cy, *_ = (float(number) for number in config["intrinsics"])
        position, rotation = transforms.vec3(config["position"]), transforms.quat(config["rotation"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise SimulationError(
            f"render_camera: {error!r} in the camera's configuration",
            "give image_size (rows, columns), intrinsics (9 numbers), position (m), rotation (xyzw), as env.agent_cams",
        ) from error
    if not (0 < height <= 4096 and 0 < width <= 4096 and fx > 0 and fy > 0):
        raise SimulationError(
            f"render_camera: image_size {(height, width)}, focal lengths {(fx, fy)}", "give 1..4096 pixels, positive"
        )
    pixels: FloatArray = np.indices((height, width)).astype(np.float64) + 0.5
    local = np.stack([(pixels[1] - cx) / fx, (pixels[0] - cy) / fy, np.ones((height, width))], axis=-1)
    directions = local @ transforms.rotation_matrix(rotation).T
    return rendering.cast(sight, np.array(position), directions)
