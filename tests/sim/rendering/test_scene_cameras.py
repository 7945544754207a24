"""Cameras of a running environment: where they look, what they see, and that OpenGL and rays agree."""

import multiprocessing
import sys
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.geometry import transforms
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import (
    InstanceCamera,
    InstanceLight,
    InstanceObject,
    InstanceTable,
    TaskInstance,
)
from grs_agents.sim.rendering import opengl
from grs_agents.sim.rendering.opengl import OpenGLError
from grs_agents.sim.rendering.scene_cameras import SceneCameras
from grs_agents.sim.world.budget import Budget
from grs_agents.sim.world.compilation import compile_world
from grs_agents.sim.world.physics import Physics
from grs_agents.sim.world.spec import instance_to_spec
from tests.needs import needs

LIBRARY = Library()
BOX, MILK, SAUCE, BALL = 1, 2, 3, 4
SIZE = (96, 128)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LOOK = transforms.to_unit_quaternion((0.65328148, 0.65328148, -0.27059805, -0.27059805))
# over the far edge of the table, 45 degrees down towards the robot, the optical axis not in the picture's middle
PHOTO = InstanceCamera(width=640, height=480, fx=600.0, fy=590.0, cx=340.0, cy=215.0, pose=((1.2, 0.0, 0.75), LOOK))


def make_instance(**changes: object) -> TaskInstance:
    """A box that is fixed, and three things that are not."""
    shown = (
        (BOX, "container/open_box.urdf", (0.5, -0.25, 0.0455), "fixed"),
        (MILK, "HOPE/Milk.urdf", (0.5, 0.15, 0.095), "rigid"),
        (SAUCE, "HOPE/TomatoSauce.urdf", (0.35, 0.0, 0.042), "rigid"),
        (BALL, "ball/ball.urdf", (0.6, 0.0, 0.03), "rigid"),
    )
    objects = tuple(
        InstanceObject.model_validate({"id": number, "asset": asset, "pose": (place, UPRIGHT), "category": kind})
        for number, asset, place, kind in shown
    )
    values: dict[str, object] = {"task": "t", "seed": 0, "max_steps": 1, "timestep": 0.004, "objects": objects}
    return TaskInstance.model_validate({**values, "goals": (), "camera": PHOTO, **changes})


def start(instance: TaskInstance) -> Physics:
    """The instance's world at its beginning."""
    return Physics(compile_world(instance_to_spec(instance, LIBRARY)), Budget(), instance.objects)


INSTANCE = make_instance()


@pytest.fixture(scope="module")
def physics() -> Physics:
    return start(INSTANCE)


def pixel_of(cameras: SceneCameras, physics: Physics, name: str, point: tuple[float, ...]) -> tuple[int, int, float]:
    """Row, column and depth (m) at which a camera should see a point of the robot's frame."""
    local = np.linalg.inv(cameras.pose(name, physics)) @ (*point, 1.0)
    x, y, _ = cameras.intrinsics(name) @ local[:3] / local[2]
    return round(float(y)), round(float(x)), float(local[2])


@given(
    st.tuples(st.integers(48, 200), st.integers(48, 200)),
    st.tuples(st.floats(250.0, 390.0), st.floats(180.0, 300.0)),
    st.tuples(st.floats(400.0, 700.0), st.floats(400.0, 700.0)),
)
@settings(max_examples=12)
def test_a_photo_of_any_size_has_its_camera(
    physics: Physics, size: tuple[int, int], middle: tuple[float, float], focal: tuple[float, float]
) -> None:
    lens = {"cx": middle[0], "cy": middle[1], "fx": focal[0], "fy": focal[1]}
    instance = INSTANCE.model_copy(update={"camera": PHOTO.model_copy(update=lens)})
    cameras = SceneCameras(instance, LIBRARY, size, ["photo"], "rays")
    picture = cameras.render(physics, "photo")
    assert picture.color.shape == (*size, 3) and picture.depth.shape == picture.owner.shape == size
    row, column, depth = pixel_of(cameras, physics, "photo", physics.object_pose(SAUCE)[0])
    assert picture.owner[row, column] == SAUCE
    assert depth - 0.08 < picture.depth[row, column] < depth
    across = (middle[0] + 0.5) / 640 * size[1] - 0.5
    assert cameras.intrinsics("photo")[0, 2] == pytest.approx(across)


def test_pictures_follow_what_moves_and_what_was_set_elsewhere() -> None:
    moved = tuple(
        item.model_copy(update={"pose": ((0.45, -0.2, 0.0455), UPRIGHT)}) if item.id == BOX else item
        for item in INSTANCE.objects
    )
    physics = start(INSTANCE.model_copy(update={"objects": moved}))
    physics.teleport_object(MILK, ((0.4, 0.25, 0.095), UPRIGHT))
    cameras = SceneCameras(INSTANCE, LIBRARY, SIZE, ["front"], "rays")
    owner = cameras.render(physics, "front").owner
    for number in (BOX, MILK, SAUCE, BALL):
        x, y, z = physics.object_pose(number)[0]
        row, column, _ = pixel_of(cameras, physics, "front", (x, y, 0.006 if number == BOX else z))
        assert owner[row, column] == number


def test_the_photo_leaves_out_an_arm_that_was_not_there(physics: Physics) -> None:
    over_the_tool = (0.35, 0.0, 1.0)
    down = (1.0, 0.0, 0.0, 0.0)
    seen: list[float] = []
    for placed in (True, False):
        camera = PHOTO.model_copy(update={"pose": (over_the_tool, down), "robot_placed": placed})
        cameras = SceneCameras(INSTANCE.model_copy(update={"camera": camera}), LIBRARY, SIZE, ["photo"], "rays")
        row, column, _ = pixel_of(cameras, physics, "photo", physics.tip_position)
        seen.append(float(cameras.render(physics, "photo").depth[row, column]))
    free, hidden = seen
    assert hidden < 0.6 < free


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_the_wrist_camera_sees_the_cup_and_what_is_below_it(robot: str) -> None:
    instance = make_instance(robot=robot)
    physics = start(instance)
    cameras = SceneCameras(instance, LIBRARY, SIZE, ["wrist"], "rays")
    x, y, z = physics.tip_position
    physics.teleport_object(SAUCE, ((x, y, 0.042), UPRIGHT))
    picture = cameras.render(physics, "wrist")
    row, column, depth = pixel_of(cameras, physics, "wrist", (x, y, z))
    assert 0 <= row < SIZE[0] and 0 <= column < SIZE[1]
    assert picture.depth[row, column] == pytest.approx(depth, abs=0.03)
    assert (picture.owner == SAUCE).mean() > 0.002


@pytest.mark.parametrize("pattern", ["plain", "checker", "speckled"])
@needs("egl")
def test_opengl_and_rays_draw_the_same(pattern: Literal["plain", "checker", "speckled"]) -> None:
    instance = make_instance(
        table=InstanceTable(pattern=pattern, color=(0.6, 0.5, 0.4, 1.0), second_color=(0.2, 0.3, 0.5, 1.0)),
        light=InstanceLight(position=(0.6, 0.4, 1.5), target=(0.4, 0.0, 0.0), diffuse=(0.6, 0.5, 0.4)),
    )
    physics = start(instance)
    drawn, cast = (SceneCameras(instance, LIBRARY, (120, 160), backend=backend) for backend in ("egl", "rays"))
    assert (drawn.backend, cast.backend) == ("egl", "rays")
    for name in drawn.names:
        by_gl, by_rays = drawn.render(physics, name), cast.render(physics, name)
        assert (np.abs(by_gl.depth - by_rays.depth) < 0.002).mean() > 0.95
        for number in np.union1d(by_gl.owner, by_rays.owner):
            first, second = by_gl.owner == number, by_rays.owner == number
            if (first | second).sum() > 50:
                assert (first & second).sum() / (first | second).sum() >= 0.95
        assert np.abs(by_gl.color.astype(float) - by_rays.color).mean() < 12
        assert (drawn.render_color(physics, name) == by_gl.color).all()
    drawn.close()
    assert drawn.render(physics, "front").color.std() > 10  # it takes up again what it gave back
    drawn.close()


def test_rays_show_textures(physics: Physics) -> None:
    picture = SceneCameras(INSTANCE, LIBRARY, SIZE, ["photo"], "rays").render(physics, "photo")
    red, _, blue = picture.color[picture.owner == MILK].astype(float).T
    assert (blue - red).std() > 20  # white and blue, in the light of one lamp


def draw_in_a_fork(cameras: SceneCameras, physics: Physics, send: Callable[[tuple[str, float]], None]) -> None:
    """Backend of the child, and the variation of its image."""
    color = cameras.render_color(physics, "front")
    send((cameras.backend, float(color.std())))


@needs("egl")
@pytest.mark.skipif(sys.platform != "linux", reason="processes are not forked there")
def test_a_forked_process_draws_by_rays_where_its_parent_has_drawn_with_opengl(physics: Physics) -> None:
    cameras = SceneCameras(INSTANCE, LIBRARY, SIZE, ["front"])
    cameras.render_color(physics, "front")
    assert cameras.backend == "egl"
    ours, theirs = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=draw_in_a_fork, args=(cameras, physics, theirs.send))
    child.start()
    assert ours.poll(60)
    backend, spread = ours.recv()
    child.join()
    assert (backend, child.exitcode) == ("rays", 0) and spread > 10
    assert cameras.render_color(physics, "front").std() > 10
    cameras.close()


def test_without_a_graphics_library_there_are_rays(physics: Physics, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "is_opengl_library_working", lambda _: False)
    cameras = SceneCameras(INSTANCE, LIBRARY, SIZE)
    assert cameras.backend == "rays" and cameras.names == ("photo", "front", "wrist")
    with pytest.raises(OpenGLError, match=r"osmesa does not draw here.*rays"):
        SceneCameras(INSTANCE, LIBRARY, SIZE, backend="osmesa")
    monkeypatch.setattr(opengl, "is_opengl_library_working", lambda _: True)
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    assert SceneCameras(INSTANCE, LIBRARY, SIZE).backend == "rays"
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(opengl, "OpenGLPainter", refuse)
    cameras = SceneCameras(INSTANCE, LIBRARY, SIZE)
    assert cameras.render_color(physics, "front").std() > 10 and cameras.backend == "rays"


def refuse(*_: object) -> None:
    """Stand-in for a driver that worked a moment ago."""
    raise OpenGLError("no context", "none")


def test_what_cannot_be_drawn_is_said(physics: Physics) -> None:
    blind = INSTANCE.model_copy(update={"camera": None})
    with pytest.raises(UnknownNameError, match=r"photo.*front, wrist"):
        SceneCameras(blind, LIBRARY, SIZE, ["photo"], "rays")
    with pytest.raises(InputError, match=r"0 x 128 px.*1 to 2048"):
        SceneCameras(INSTANCE, LIBRARY, (0, 128), backend="rays")
    with pytest.raises(UnknownNameError, match="backend"):
        make_with_any_backend("vulkan")
    with pytest.raises(UnknownNameError, match="wrist"):
        SceneCameras(INSTANCE, LIBRARY, SIZE, ["front"], "rays").render(physics, "wrist")


def make_with_any_backend(name: Any) -> SceneCameras:
    return SceneCameras(INSTANCE, LIBRARY, SIZE, backend=name)
