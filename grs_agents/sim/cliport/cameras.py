"""Cameras under CLIPort's configuration: a dictionary of image size, intrinsics, position and rotation.

Pictures are rendered only when somebody looks. Maps show the workspace straight from above, with pixels of one size.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.rendering.cameras import FRONT, LEFT, RIGHT, LookAtCamera, RenderedImage, VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays, render_observation

CameraConfig = dict[str, Any]


def camera_config_from_view(view: LookAtCamera) -> CameraConfig:
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
        "rotation": transforms.to_unit_quaternion(rotation[[1, 2, 3, 0]]),
        "zrange": (0.01, 10.0),
        "noise": False,
    }


AGENT_CAMERAS: tuple[CameraConfig, ...] = tuple(camera_config_from_view(view) for view in (FRONT, LEFT, RIGHT))


def render_from_camera_config(sight: VisibleScene, config: Mapping[str, Any]) -> RenderedImage:
    """Picture of a configured camera; raises ``SimulationError`` for a configuration that does not fit."""
    try:
        height, width = (int(count) for count in config["image_size"])
        fx, _, cx, _, fy, cy, *_ = (float(number) for number in config["intrinsics"])
        position, rotation = transforms.to_vec3(config["position"]), transforms.to_unit_quaternion(config["rotation"])
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
    directions = local @ transforms.quaternion_to_matrix(rotation).T
    return render_along_rays(sight, np.array(position), directions)


_FAR: Final = 100.0
"""Height of the eye, metres: the parallax of an object 0.3 m high is then below a pixel."""


def render_top_down_maps(
    objects: Sequence[InstanceObject], library: Library, bounds: FloatArray, pixel: float
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Colour (H, W, 3), height above the table (H, W; m), object id (H, W; 0 = none); rows along y, columns along x.

    ``bounds`` (3, 2) are metres, ``pixel`` is metres a pixel; the arm is not seen.
    """
    columns, rows = (round(float(extent) / pixel) for extent in bounds[:2, 1] - bounds[:2, 0])
    cells: FloatArray = np.indices((rows, columns)).astype(np.float64) + 0.5
    x, y = float(bounds[0, 0]) + cells[1] * pixel, float(bounds[1, 0]) + cells[0] * pixel
    eye = np.array([bounds[0].mean(), bounds[1].mean(), _FAR])
    directions = np.stack([x - eye[0], y - eye[1], np.full(x.shape, -_FAR)], axis=-1) / _FAR
    picture = render_along_rays(VisibleScene(objects, library), eye, directions)
    height = np.where(picture.depth > 0, _FAR - picture.depth, 0)
    return picture.color, np.maximum(height, 0).astype(np.float32), np.maximum(picture.owner, 0)


class Observation(Mapping[str, Any]):
    """``color``: three (480, 640, 3) uint8 images; ``depth``: three (480, 640) float32 images, metres."""

    def __init__(self, sight: VisibleScene) -> None:
        self._sight = sight
        self._images: dict[str, tuple[npt.NDArray[Any], ...]] | None = None

    def __getitem__(self, key: str) -> tuple[npt.NDArray[Any], ...]:
        if key not in ("color", "depth"):
            raise KeyError(key)
        images = self._images or render_observation(self._sight)
        self._images = images
        return images[key]

    def __iter__(self) -> Iterator[str]:
        return iter(("color", "depth"))

    def __len__(self) -> int:
        return 2
