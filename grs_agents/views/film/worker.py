"""The process that renders a film or opens MuJoCo's window: ``python -m grs_agents.views.film.worker``. It is a
separate process because MuJoCo selects its graphics library at import. A job (JSON) comes on stdin; the frames go to
stdout in order, (height, width, 3) bytes each."""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.terminal import print_escaped

STILLS = 24
"""Largest number of pictures that are antialiased."""
Image = npt.NDArray[np.uint8]
_FACETS = (16, 8)
"""Facets of round links, about the axis and along it, in a film: a third cheaper than MuJoCo's defaults, hardly
visible."""
_NOWHERE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class _Stages:
    """Builds stages; consecutive rollouts of the same objects share a stage, which costs as much as ten pictures."""

    def __init__(self, job: dict[str, Any]) -> None:
        self._samples = 4 if sum(len(rollout["seconds"]) for rollout in job["rollouts"]) <= STILLS else 0
        self._shown: Any = None  # objects of the last stage, without their poses, and the library's roots
        self._stage: Any = None

    def set_up_rollout_stage(self, rollout: dict[str, Any]) -> tuple[Any, Any, Any]:
        """Returns: the stage at the rollout's first poses, the motion, and the arm's joint positions (N, nq)."""
        from grs_agents.library.library import Library
        from grs_agents.sim.rendering.stage import Stage, scene_props_from_instance
        from grs_agents.views.common.rollout_motion import read_motion, read_task_instance
        from grs_agents.views.film.recorded_motion import recover_joint_positions

        props = scene_props_from_instance(read_task_instance(Path(rollout["instance"])))
        table = props.table
        if table.pattern == "plain" and table.texture is None:  # speckles make motion over the table visible
            darker = (*(0.86 * channel for channel in table.color[:3]), 1.0)
            table = table.model_copy(update={"pattern": "speckled", "second_color": darker})
        props = replace(props, samples=self._samples, table=table)
        unposed = [item.model_copy(update={"pose": _NOWHERE}) for item in props.objects]
        shown = (replace(props, objects=unposed), rollout["roots"])
        if shown != self._shown:
            self._stage = Stage(props, Library(*(Path(root) for root in rollout["roots"])))
            self._shown = shown
        for item in props.objects:
            self._stage.set_object_pose(item.id, np.array(item.pose[0]), np.array(item.pose[1]))
        motion = read_motion(Path(rollout["recording"]))
        return self._stage, motion, recover_joint_positions(self._stage.model, motion)


def _make_camera(mujoco: Any, job: dict[str, Any]) -> Any:
    camera = mujoco.MjvCamera()
    camera.lookat[:] = job["target"]
    camera.distance, camera.azimuth, camera.elevation = job["distance"], job["azimuth"], job["elevation"]
    return camera


def write_rendered_frames(job: dict[str, Any], output: BinaryIO) -> None:
    """Write the requested frames, rendered with OpenGL or, if ``job["rays"]``, by ray casting."""
    make = _make_raycast_renderer
    if not job["rays"]:
        # before anything else imports it: with the graphics library of MUJOCO_GL
        make = partial(_make_opengl_renderer, importlib.import_module("mujoco"))
    from grs_agents.views.film.recorded_motion import show_recorded_frame

    stages, drawn, picture = _Stages(job), None, None
    for rollout in job["rollouts"]:
        stage, motion, joints = stages.set_up_rollout_stage(rollout)
        if picture is None or stage is not drawn:
            drawn, picture = stage, make(stage, job)
        for seconds in rollout["seconds"]:
            show_recorded_frame(stage, motion, motion.frame_index_at(seconds), joints)
            output.write(np.ascontiguousarray(picture()).tobytes())
    output.flush()


def _make_opengl_renderer(mujoco: Any, stage: Any, job: dict[str, Any]) -> Callable[[], Image]:
    camera, room, quality = _make_camera(mujoco, job), stage.model.vis.global_, stage.model.vis.quality
    room.offwidth, room.offheight = job["width"], job["height"]  # each picture clears all of it
    if not quality.offsamples:
        quality.numslices, quality.numstacks = _FACETS
    renderer = mujoco.Renderer(stage.model, job["height"], job["width"])

    def paint() -> Image:
        renderer.update_scene(stage.data, camera)
        return renderer.render()

    return paint


def _make_raycast_renderer(stage: Any, job: dict[str, Any]) -> Callable[[], Image]:
    from grs_agents.sim.rendering.cameras import LookAtCamera, lens_from_field_of_view, view_pose
    from grs_agents.sim.rendering.ray_painter import RayPainter

    azimuth, elevation = np.deg2rad(job["azimuth"]), np.deg2rad(job["elevation"])
    ahead = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    eye = np.array(job["target"]) - job["distance"] * ahead
    x, y, z = (float(value) for value in eye)
    view = LookAtCamera((x, y, z), tuple(job["target"]), 45.0, job["height"], job["width"])
    painter = RayPainter(stage, view.height, view.width)
    lens, pose = lens_from_field_of_view(view.field_of_view, view.height, view.width), view_pose(view)

    def paint() -> Image:
        painter.prepare_view(lens, pose)
        return painter.draw_color()

    return paint


def play_in_mujoco_window(job: dict[str, Any]) -> None:
    """Play the motion in MuJoCo's window in a loop until it is closed."""
    mujoco = importlib.import_module("mujoco")
    viewer_module = importlib.import_module("mujoco.viewer")
    from grs_agents.views.film.recorded_motion import show_recorded_frame

    stage, motion, joints = _Stages(job).set_up_rollout_stage(job["rollouts"][0])
    with viewer_module.launch_passive(stage.model, stage.data, show_left_ui=False, show_right_ui=False) as viewer:
        camera = _make_camera(mujoco, job)
        viewer.cam.lookat[:], viewer.cam.distance = camera.lookat, camera.distance
        viewer.cam.azimuth, viewer.cam.elevation = camera.azimuth, camera.elevation
        begin = time.monotonic()
        while viewer.is_running():
            seconds = (time.monotonic() - begin) % (motion.duration_seconds + 1.0)  # holds the last frame for a second
            with viewer.lock():
                show_recorded_frame(stage, motion, motion.frame_index_at(min(seconds, motion.duration_seconds)), joints)
            viewer.sync()
            time.sleep(1 / 60)


def main() -> None:
    """Run the job on stdin. Output of libraries goes to stderr, to keep it out of the frames."""
    job = json.load(sys.stdin)
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        try:
            (play_in_mujoco_window if job["window"] else partial(write_rendered_frames, output=output))(job)
        except InputError as error:
            print_escaped(str(error), error=True)
            sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
