"""Images by MuJoCo's OpenGL renderer, off-screen and in this process, whatever ``MUJOCO_GL`` said at import."""

import atexit
import functools
import importlib
import os
import subprocess
import sys
from typing import Any, Final
from weakref import WeakSet

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import GrsError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.asset_rendering import Lens
from grs_agents.sim.rendering.stage import ARM_GROUP, Stage

LIBRARIES: Final = ("egl", "osmesa")
"""Graphics libraries for off-screen rendering, best first."""
_NEAR, _FAR = 0.01, 50.0
"""Clipping planes, m."""
_SMALL: Final = 256
_COARSE: Final = (16, 10)
"""Slices and stacks of round geoms in images of at most ``_SMALL`` pixels a side; MuJoCo's defaults are 28 and 16."""
_QUADS: Final = 6
"""Quads along the side of a box, each lit at its corners: MuJoCo's 4 lose the spot of light on the table."""
_MOST_GEOMS: Final = 2000
_PROBE: Final = """
import importlib, sys, mujoco
context = importlib.import_module("mujoco." + sys.argv[1]).GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 50)
"""


class OpenGLError(GrsError):
    """A graphics library is missing or does not render."""


def choose_opengl_library() -> str | None:
    """Graphics library to render with: that of ``MUJOCO_GL`` if set, else the first that works, else None.

    Each is first tried in a child process, once, since a broken driver may crash its process.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in ("disable", "disabled", "off", "false", "0") or not sys.platform.startswith("linux"):
        return None
    names = (wanted,) if wanted in LIBRARIES else LIBRARIES
    return next((name for name in names if is_opengl_library_working(name)), None)


@functools.cache
def is_opengl_library_working(library: str) -> bool:
    """Whether a graphics library renders here; tested once in a child process."""
    command = [sys.executable, "-c", _PROBE, library]
    environment = {**os.environ, "MUJOCO_GL": "disabled"}  # or MuJoCo would look for another library first
    environment.pop("PYOPENGL_PLATFORM", None)  # set in this process by a library used before
    try:
        done = subprocess.run(command, env=environment, capture_output=True, stdin=subprocess.DEVNULL, check=False)
        return done.returncode == 0
    except OSError:  # no process may be started, as in the sandbox
        return False


_processes_that_drew: Final[set[int]] = set()
_open: Final[WeakSet["OpenGLPainter"]] = WeakSet()


class OpenGLPainter:
    """Draws a stage in images of a fixed size; bound to the thread that created it."""

    def __init__(self, stage: Stage, height: int, width: int, library: str) -> None:
        self._stage, self._shape, self._resources = stage, (height, width), None
        self._process = os.getpid()
        if _processes_that_drew - {self._process}:
            raise OpenGLError(
                f"{library} cannot draw in a process forked from one that has drawn", "start the process with 'spawn'"
            )
        try:
            self._context: Any = importlib.import_module(f"mujoco.{library}").GLContext(width, height)
        except Exception as error:
            raise OpenGLError(f"{library} does not draw here: {error}", "see `grs doctor`, or draw by rays") from error
        if not _processes_that_drew:
            atexit.register(_close_all_painters)
        _processes_that_drew.add(self._process)
        self._context.make_current()
        model = stage.model
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        if max(height, width) <= _SMALL:
            model.vis.quality.numslices, model.vis.quality.numstacks = _COARSE
        model.vis.quality.numquads = _QUADS
        self._resources = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        _open.add(self)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._resources)
        self._resources.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = bool(model.vis.quality.shadowsize)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._option.sitegroup[:] = 0
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._owners: dict[bool, npt.NDArray[np.int32]] = {}

    def prepare_view(self, lens: Lens, pose: FloatArray, arm: bool = True) -> None:
        """Capture the current state of the stage through ``lens`` from ``pose`` (T_robot_cam, OpenCV axes)."""
        self._option.geomgroup[ARM_GROUP] = arm
        stage, everything = self._stage, mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(stage.model, stage.data, self._option, None, self._camera, everything, self._scene)
        top, bottom = (lens.cy + 0.5) / lens.fy * _NEAR, (lens.height - lens.cy - 0.5) / lens.fy * _NEAR
        left, right = (lens.cx + 0.5) / lens.fx * _NEAR, (lens.width - lens.cx - 0.5) / lens.fx * _NEAR
        for camera in self._scene.camera:
            camera.pos, camera.forward, camera.up = pose[:3, 3], pose[:3, 2], -pose[:3, 1]
            camera.frustum_near, camera.frustum_far = _NEAR, _FAR
            camera.frustum_top, camera.frustum_bottom = top, -bottom
            camera.frustum_center, camera.frustum_width = (right - left) / 2, (right + left) / 2
        for light in self._scene.lights[: self._scene.nlight]:
            if light.headlight:
                light.pos, light.dir = pose[:3, 3], pose[:3, 2]
        self._arm = arm

    def draw_color(self) -> npt.NDArray[np.uint8]:
        """Colour image (H, W, 3) of the prepared view."""
        self._context.make_current()
        color = np.empty((*self._shape, 3), np.uint8)
        mujoco.mjr_render(self._rectangle, self._scene, self._resources)
        mujoco.mjr_readPixels(color, None, self._rectangle, self._resources)
        return color[::-1]

    def draw_depth_and_owner(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Depth (H, W), m along the optical axis, 0 without a hit, and owner (H, W), object id or -1."""
        self._context.make_current()
        flags, number = self._scene.flags, np.empty((*self._shape, 3), np.uint8)
        depth = np.empty(self._shape, np.float32)
        before = flags.copy()
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = True
        flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False
        mujoco.mjr_render(self._rectangle, self._scene, self._resources)
        flags[:] = before
        mujoco.mjr_readPixels(number, depth, self._rectangle, self._resources)
        segment = number[..., 0] + (number[..., 1].astype(np.int32) << 8)
        if self._arm not in self._owners:  # object id by segment number; 0 is the background
            geoms = self._scene.geoms[: self._scene.ngeom]
            owners = np.full(len(geoms) + 1, -1, np.int32)
            for geom in geoms:
                if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    owners[geom.segid + 1] = self._stage.owners[geom.objid]
            self._owners[self._arm] = owners
        metres = _NEAR * _FAR / (_NEAR + depth * np.float32(_FAR - _NEAR))
        return np.where(segment > 0, metres, np.float32(0))[::-1], self._owners[self._arm][segment][::-1]

    @property
    def is_usable(self) -> bool:
        """Whether this process created the painter: a forked child cannot draw with it."""
        return self._process == os.getpid()

    def close(self) -> None:
        """Release the resources of the graphics library."""
        if self._resources is not None and self.is_usable:
            with self._context.as_current():
                self._resources.free()
            self._resources = None
            self._context.free()

    def __del__(self) -> None:
        self.close()


def _close_all_painters() -> None:
    """At exit, before the graphics library itself is torn down."""
    for painter in list(_open):
        painter.close()
