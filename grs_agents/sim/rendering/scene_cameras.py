"""The cameras of a running environment: the photo's, the front and the wrist camera."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rendering import opengl
from grs_agents.sim.rendering.cameras import FRONT, RenderedImage, lens_from_field_of_view, resize_lens, view_pose
from grs_agents.sim.rendering.ray_painter import RayPainter
from grs_agents.sim.rendering.stage import LARGEST_PICTURE, Stage, scene_props_from_instance
from grs_agents.sim.world.physics import Physics

Backend = Literal["auto", "egl", "osmesa", "rays"]
BACKENDS: Final[tuple[Backend, ...]] = get_args(Backend)
CAMERAS: Final = ("photo", "front", "wrist")
_QUICK: Final = {"samples": 0, "shadows": False, "flash": 0.2, "glossy": False}
_WRIST_AT: Final = (0.09, 0.0, -0.14)
_WRIST_TILT: Final = 0.3
_WRIST_FIELD_OF_VIEW: Final = 65.0
"""Wrist camera: position in the tip frame (m; z points out of the cup), tilt towards the cup (rad), vertical field of
view (deg)."""


class SceneCameras:
    """Renders a running environment from its cameras.

    Args:
        instance: the task instance that the environment runs.
        library: source of its assets.
        size: rows and columns of the images.
        names: cameras to set up, of ``CAMERAS``; "photo" only if the instance has a camera.
        backend: renderer. "auto" takes OpenGL if it works (EGL, then OSMesa), else rays.

    Raises ``UnknownNameError`` for an unknown camera, ``InputError`` for a size or an asset that cannot be drawn,
    ``OpenGLError`` if the named ``backend`` does not work here.
    """

    def __init__(
        self,
        instance: TaskInstance,
        library: Library,
        size: tuple[int, int],
        names: Sequence[str] = CAMERAS,
        backend: Backend = "auto",
    ) -> None:
        if backend not in BACKENDS:
            raise UnknownNameError("backend", backend, BACKENDS)
        available = tuple(name for name in CAMERAS if name != "photo" or instance.camera is not None)
        for name in names:
            if name not in available:
                raise UnknownNameError("camera", name, available)
        if not all(1 <= side <= LARGEST_PICTURE for side in size):
            raise InputError(
                f"pictures of {size[0]} x {size[1]} px", f"ask for 1 to {LARGEST_PICTURE} rows and columns"
            )
        self._size = size
        self.shift: Pose | None = None  # of each camera in its own frame, m
        self._library = opengl.choose_opengl_library() if backend == "auto" else None if backend == "rays" else backend
        self._automatic = backend == "auto"
        if backend in opengl.LIBRARIES and not opengl.is_opengl_library_working(backend):
            raise opengl.OpenGLError(f"{backend} does not draw here", "see `grs doctor`, or draw by rays")
        self._stage = Stage(replace(scene_props_from_instance(instance), **_QUICK), library)
        self._painter: Painter | None = None
        height, width = size
        lenses = {
            "front": lens_from_field_of_view(FRONT.field_of_view, height, width),
            "wrist": lens_from_field_of_view(_WRIST_FIELD_OF_VIEW, height, width),
        }
        self._photo = photo = instance.camera
        if photo is not None:
            lens = Lens(photo.fx, photo.fy, photo.cx, photo.cy, photo.width, photo.height)
            lenses["photo"] = resize_lens(lens, height, width)
        self._lenses = {name: lenses[name] for name in names}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cameras, in the order requested."""
        return tuple(self._lenses)

    @property
    def backend(self) -> str:
        """The renderer in use: "egl", "osmesa" or "rays"."""
        return self._library or "rays"

    def intrinsics(self, name: str) -> FloatArray:
        """Camera matrix (3, 3) in pixels, the centre of the first pixel at (0, 0)."""
        lens = self._lens_by_name(name)
        return np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1.0]])

    def pose(self, name: str, physics: Physics) -> FloatArray:
        """T_robot_cam (4, 4), OpenCV axes, m."""
        self._lens_by_name(name)
        self._stage.copy_state(physics)
        return self._pose(name)

    def render(self, physics: Physics, name: str) -> RenderedImage:
        """Colour, depth and object ids as a camera sees them."""
        painter = self._aim_painter(physics, name)
        return RenderedImage(painter.draw_color(), *painter.draw_depth_and_owner())

    def render_color(self, physics: Physics, name: str) -> npt.NDArray[np.uint8]:
        """Colour image (H, W, 3) alone, which is faster."""
        return self._aim_painter(physics, name).draw_color()

    def close(self) -> None:
        """Release the resources of the graphics library; the next image acquires them again."""
        if self._painter is not None:
            self._painter.close()
            self._painter = None

    def _aim_painter(self, physics: Physics, name: str) -> "Painter":
        lens = self._lens_by_name(name)
        self._stage.copy_state(physics)
        painter = self._painter
        if painter is None or not painter.is_usable:
            painter = None
            if self._library is not None:
                try:
                    painter = opengl.OpenGLPainter(self._stage, *self._size, self._library)
                except opengl.OpenGLError:
                    if not self._automatic:
                        raise
                    self._library = None
            self._painter = painter = painter or RayPainter(self._stage, *self._size)
        painter.prepare_view(
            lens, self._pose(name), arm=not (name == "photo" and self._photo and self._photo.robot_placed)
        )
        return painter

    def _lens_by_name(self, name: str) -> Lens:
        if name not in self._lenses:
            raise UnknownNameError("camera", name, self.names)
        return self._lenses[name]

    def _pose(self, name: str) -> FloatArray:
        placed = self._unshifted_pose(name)
        if self.shift is None:
            return placed
        position, rotation = self.shift
        return placed @ pose_matrix(transforms.quaternion_to_matrix(rotation), np.array(position))

    def _unshifted_pose(self, name: str) -> FloatArray:
        if name == "photo" and self._photo is not None:
            position, rotation = self._photo.pose
            return pose_matrix(transforms.quaternion_to_matrix(rotation), np.array(position))
        return view_pose(FRONT) if name == "front" else self._stage.tip_pose @ _WRIST


class Painter(Protocol):
    """A renderer of stages."""

    @property
    def is_usable(self) -> bool:
        """Whether it can draw in this process."""
        ...

    def prepare_view(self, lens: Lens, pose: FloatArray, arm: bool = True) -> None:
        """Capture the current state of the stage through ``lens`` from ``pose`` (T_robot_cam, OpenCV axes)."""
        ...

    def draw_color(self) -> npt.NDArray[np.uint8]:
        """Colour image (H, W, 3) of the prepared view."""
        ...

    def draw_depth_and_owner(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Depth (H, W), m along the optical axis, 0 without a hit, and owner (H, W), object id or -1."""
        ...

    def close(self) -> None:
        """Release its resources."""
        ...


def _wrist_pose() -> FloatArray:
    """T_tip_cam (4, 4): the cup is at the lower edge of the image."""
    sine, cosine = np.sin(_WRIST_TILT), np.cos(_WRIST_TILT)
    down, forward = np.array([-cosine, 0.0, -sine]), np.array([-sine, 0.0, cosine])
    return pose_matrix(np.stack([np.cross(down, forward), down, forward], axis=1), np.array(_WRIST_AT))


_WRIST: Final = _wrist_pose()
