"""The process that draws a film or opens MuJoCo's window: ``python -m grs_agents.views.film.worker``.
It is a process of its own because MuJoCo decides when it is imported which graphics library it draws with. An order
(JSON) comes on stdin; the frames go to stdout one after the other, (height, width, 3) bytes each."""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.terminal import print_escaped

STILLS = 24
"""Up to so many pictures are drawn with smooth edges."""
Image = npt.NDArray[np.uint8]
_FACETS = (16, 8)
"""Of round links, about the axis and along it, in a film: a third cheaper than MuJoCo's own, and hardly to be seen."""
_NOWHERE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class _Stages:
    """Makes stages; rollouts of the same things share one: a new one costs as much as ten pictures."""

    def __init__(self, order: dict[str, Any]) -> None:
        self._samples = 4 if sum(len(rollout["seconds"]) for rollout in order["rollouts"]) <= STILLS else 0
        self._shown: Any = None  # the things of the last stage, wherever they are, and where they come from
        self._stage: Any = None

    def set_up_rollout_stage(self, rollout: dict[str, Any]) -> tuple[Any, Any, Any]:
        """The stage, with everything where the rollout began, the motion, and the joints of the arm in it."""
        from grs_agents.library.library import Library
        from grs_agents.sim.rendering.stage import Stage, scene_props_from_instance
        from grs_agents.views.common.rollout_motion import read_motion, read_task_instance
        from grs_agents.views.film.recorded_motion import recover_joint_positions

        props = scene_props_from_instance(read_task_instance(Path(rollout["instance"])))
        props = replace(props, samples=self._samples, table=_add_speckles_to_plain_table(props.table))
        somewhere = [item.model_copy(update={"pose": _NOWHERE}) for item in props.objects]
        shown = (replace(props, objects=somewhere), rollout["roots"])
        if shown != self._shown:
            self._stage = Stage(props, Library(*(Path(root) for root in rollout["roots"])))
            self._shown = shown
        for item in props.objects:
            self._stage.set_object_pose(item.id, np.array(item.pose[0]), np.array(item.pose[1]))
        motion = read_motion(Path(rollout["recording"]))
        return self._stage, motion, recover_joint_positions(self._stage.model, motion)


def _add_speckles_to_plain_table(table: Any) -> Any:
    """The look of a table top, speckled where it is of one colour: what moves over it is seen to move."""
    if table.pattern != "plain" or table.texture is not None:
        return table
    darker = (*(0.86 * channel for channel in table.color[:3]), 1.0)
    return table.model_copy(update={"pattern": "speckled", "second_color": darker})


def _make_camera(mujoco: Any, order: dict[str, Any]) -> Any:
    camera = mujoco.MjvCamera()
    camera.lookat[:] = order["target"]
    camera.distance, camera.azimuth, camera.elevation = order["distance"], order["azimuth"], order["elevation"]
    return camera


def write_rendered_frames(order: dict[str, Any], output: BinaryIO) -> None:
    """Write the ordered frames, with OpenGL or, if ``order["rays"]``, without."""
    make = _make_raycast_renderer
    if not order["rays"]:
        # before anything else imports it: with the graphics library of MUJOCO_GL
        make = partial(_make_opengl_renderer, importlib.import_module("mujoco"))
    from grs_agents.views.film.recorded_motion import show_recorded_frame

    stages, drawn, picture = _Stages(order), None, None
    for rollout in order["rollouts"]:
        stage, motion, joints = stages.set_up_rollout_stage(rollout)
        if picture is None or stage is not drawn:
            drawn, picture = stage, make(stage, order)
        for seconds in rollout["seconds"]:
            show_recorded_frame(stage, motion, motion.frame_index_at(seconds), joints)
            output.write(np.ascontiguousarray(picture()).tobytes())
    output.flush()


def _make_opengl_renderer(mujoco: Any, stage: Any, order: dict[str, Any]) -> Callable[[], Image]:
    camera, room, quality = _make_camera(mujoco, order), stage.model.vis.global_, stage.model.vis.quality
    room.offwidth, room.offheight = order["width"], order["height"]  # each picture clears all of it
    if not quality.offsamples:
        quality.numslices, quality.numstacks = _FACETS
    renderer = mujoco.Renderer(stage.model, order["height"], order["width"])

    def paint() -> Image:
        renderer.update_scene(stage.data, camera)
        return renderer.render()

    return paint


def _make_raycast_renderer(stage: Any, order: dict[str, Any]) -> Callable[[], Image]:
    from grs_agents.sim.rendering.lenses import lens_from_field_of_view, view_pose
    from grs_agents.sim.rendering.ray_painter import RayPainter
    from grs_agents.sim.rendering.views import View

    azimuth, elevation = np.deg2rad(order["azimuth"]), np.deg2rad(order["elevation"])
    ahead = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    eye = np.array(order["target"]) - order["distance"] * ahead
    x, y, z = (float(value) for value in eye)
    view = View((x, y, z), tuple(order["target"]), 45.0, order["height"], order["width"])
    painter = RayPainter(stage, view.height, view.width)
    lens, pose = lens_from_field_of_view(view.field_of_view, view.height, view.width), view_pose(view)

    def paint() -> Image:
        painter.prepare_view(lens, pose)
        return painter.draw_color()

    return paint


def play_in_mujoco_window(order: dict[str, Any]) -> None:
    """Play the motion in MuJoCo's window, again and again, until it is closed."""
    mujoco = importlib.import_module("mujoco")
    viewer_module = importlib.import_module("mujoco.viewer")
    from grs_agents.views.film.recorded_motion import show_recorded_frame

    stage, motion, joints = _Stages(order).set_up_rollout_stage(order["rollouts"][0])
    with viewer_module.launch_passive(stage.model, stage.data, show_left_ui=False, show_right_ui=False) as viewer:
        camera = _make_camera(mujoco, order)
        viewer.cam.lookat[:], viewer.cam.distance = camera.lookat, camera.distance
        viewer.cam.azimuth, viewer.cam.elevation = camera.azimuth, camera.elevation
        for seconds in _iterate_looped_seconds(motion.duration_seconds + 1.0):
            if not viewer.is_running():
                return
            with viewer.lock():
                show_recorded_frame(stage, motion, motion.frame_index_at(min(seconds, motion.duration_seconds)), joints)
            viewer.sync()
            time.sleep(1 / 60)


def _iterate_looped_seconds(period: float) -> Iterator[float]:
    """Seconds since the beginning, from 0 again after each ``period``."""
    begin = time.monotonic()
    while True:
        yield (time.monotonic() - begin) % period


def main() -> None:
    """Do what the order on stdin says; whatever a library prints goes to stderr, not among the frames."""
    order = json.load(sys.stdin)
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        try:
            (play_in_mujoco_window if order["window"] else partial(write_rendered_frames, output=output))(order)
        except InputError as error:
            print_escaped(str(error), error=True)
            sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
