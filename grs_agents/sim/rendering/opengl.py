"""Pictures by MuJoCo's OpenGL, off-screen and in this process, whatever ``MUJOCO_GL`` was when MuJoCo was imported."""

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
"""The graphics libraries that draw without a display, best first."""
_NEAR, _FAR = 0.01, 50.0
"""What is nearer or farther is cut off, m."""
_SMALL: Final = 256
_COARSE: Final = (16, 10)
"""Slices and stacks of round things in pictures with at most so many pixels on a side; MuJoCo draws 28 and 16."""
_QUADS: Final = 6
"""Parts along the side of a box, each lit at its corners: MuJoCo's 4 lose the spot of light on the table."""
_MOST_GEOMS: Final = 2000
_PROBE: Final = """
import importlib, sys, mujoco
context = importlib.import_module("mujoco." + sys.argv[1]).GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 50)
"""


class OpenGLError(GrsError):
    """A graphics library is not there, or does not draw."""


def choose_opengl_library() -> str | None:
    """The graphics library to draw with, None where none works; that of ``MUJOCO_GL`` if it names one.

    Each is first tried in a process of its own, once, since a broken driver may take its process with it.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in ("disable", "disabled", "off", "false", "0") or not sys.platform.startswith("linux"):
        return None
    names = (wanted,) if wanted in LIBRARIES else LIBRARIES
    return next((name for name in names if is_opengl_library_working(name)), None)


@functools.cache
def is_opengl_library_working(library: str) -> bool:
    """Whether a graphics library draws here; found out in a process of its own, remembered in this one."""
    command = [sys.executable, "-c", _PROBE, library]
    environment = {**os.environ, "MUJOCO_GL": "disabled"}  # or MuJoCo would look for another library first
    environment.pop("PYOPENGL_PLATFORM", None)  # set here by a library that was used before
    try:
        done = subprocess.run(command, env=environment, capture_output=True, stdin=subprocess.DEVNULL, check=False)
        return done.returncode == 0
    except OSError:  # no process may be started, as in the sandbox
        return False


_processes_that_drew: Final[set[int]] = set()
_open: Final[WeakSet["OpenGLPainter"]] = WeakSet()


def _close_all_painters() -> None:
    """Before the graphics library itself goes at the end of the process."""
    for painter in list(_open):
        painter.close()


def _make_context(library: str, height: int, width: int) -> Any:
    """A context of MuJoCo's, which has to be kept as long as something is drawn with it."""
    if _processes_that_drew - {os.getpid()}:
        raise OpenGLError(
            f"{library} cannot draw in a process forked from one that has drawn", "start the process with 'spawn'"
        )
    try:
        context = importlib.import_module(f"mujoco.{library}").GLContext(width, height)
    except Exception as error:
        raise OpenGLError(f"{library} does not draw here: {error}", "see `grs doctor`, or draw by rays") from error
    if not _processes_that_drew:
        atexit.register(_close_all_painters)
    _processes_that_drew.add(os.getpid())
    return context


class OpenGLPainter:
    """Draws a stage in pictures of one size; to be used by the thread that made it."""

    def __init__(self, stage: Stage, height: int, width: int, library: str) -> None:
        self._stage, self._shape, self._resources = stage, (height, width), None
        self._process = os.getpid()
        self._context = _make_context(library, height, width)
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
        """Take up how the stage is now, seen through ``lens`` from ``pose`` (T_robot_cam, OpenCV axes)."""
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
        """(H, W, 3) as seen from where ``look`` was told."""
        self._context.make_current()
        color = np.empty((*self._shape, 3), np.uint8)
        mujoco.mjr_render(self._rectangle, self._scene, self._resources)
        mujoco.mjr_readPixels(color, None, self._rectangle, self._resources)
        return color[::-1]

    def draw_depth_and_owner(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """(H, W) each: metres along the optical axis, 0 for nothing; object id or -1."""
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
        seen = segment > 0
        metres = _NEAR * _FAR / (_NEAR + depth * np.float32(_FAR - _NEAR))
        return np.where(seen, metres, np.float32(0))[::-1], self._owners_by_segment()[segment][::-1]

    def _owners_by_segment(self) -> npt.NDArray[np.int32]:
        """Object id by the number that a picture of segments has at a pixel; 0 there is nothing, here -1."""
        if self._arm not in self._owners:
            geoms = self._scene.geoms[: self._scene.ngeom]
            owners = np.full(len(geoms) + 1, -1, np.int32)
            for geom in geoms:
                if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    owners[geom.segid + 1] = self._stage.owners[geom.objid]
            self._owners[self._arm] = owners
        return self._owners[self._arm]

    @property
    def is_usable(self) -> bool:
        """Whether this is the process that made it: what is forked from that cannot draw with it."""
        return self._process == os.getpid()

    def close(self) -> None:
        """Give back what the graphics library holds."""
        if self._resources is not None and self.is_usable:
            with self._context.as_current():
                self._resources.free()
            self._resources = None
            self._context.free()

    def __del__(self) -> None:
        self.close()
