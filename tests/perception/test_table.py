"""The table's plane and the frame laid on it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.config.schema import TableChoice
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import (
    matrix_to_quaternion,
    pose_matrix,
    quaternion_to_matrix,
    rotation_about_axis,
)
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import (
    describe_table_doubts,
    find_table,
    pixels_to_robot_frame,
    project_to_pixels,
    robot_frame_point_map,
)
from grs_agents.perception.types import Camera, RGBDFrame
from tests.perception import room
from tests.perception.conftest import Rendered, Thing, look_at, render
from tests.perception.settling.photo import LIBRARY, MILK, photo_of, standing


def test_a_calibrated_frame_is_kept(rendered: Rendered) -> None:
    table = find_table(rendered.frame, np.random.default_rng(0))
    assert table.origin == "calibrated"
    assert table.height == pytest.approx(0, abs=0.002)
    given = rendered.frame.camera.T_robot_cam
    assert given is not None and np.allclose(table.T_robot_cam, given, atol=0.002)


def test_a_frame_without_calibration_agrees_with_the_calibrated_one(rendered: Rendered) -> None:
    camera = rendered.frame.camera.model_copy(update={"T_robot_cam": None})
    table = find_table(replace(rendered.frame, camera=camera), np.random.default_rng(0))
    assert table.origin == "table_plane"
    assert table.note
    up, true_up = np.array(table.T_robot_cam)[2], np.array(rendered.frame.camera.T_robot_cam)[2]
    assert np.rad2deg(np.arccos(min(1.0, up[:3] @ true_up[:3]))) < 1.0
    assert up[3] == pytest.approx(true_up[3], abs=0.005)


def test_the_lowest_plane_is_the_table() -> None:
    books = [Thing("box", (0.35 + 0.33 * i, -0.3 + 0.3 * j), (0.3, 0.27, 0.03)) for i in range(2) for j in range(3)]
    scene = render(books, calibrated=True)
    assert find_table(scene.frame, np.random.default_rng(0)).height == pytest.approx(0, abs=0.004)


def test_points_are_in_the_robot_frame_and_unknown_ones_are_nan(rendered: Rendered) -> None:
    points = robot_frame_point_map(rendered.frame, find_table(rendered.frame, np.random.default_rng(0)))
    known = rendered.frame.depth > 0
    assert np.isnan(points[~known]).all()
    assert float(np.median(points[known & (rendered.labels == 0)][:, 2])) == pytest.approx(0, abs=0.002)


def test_no_table_plane_is_refused(rendered: Rendered) -> None:
    rng = np.random.default_rng(0)
    rough = rng.uniform(0.4, 4.0, rendered.frame.depth.shape).astype(np.float32)
    camera = rendered.frame.camera.model_copy(update={"T_robot_cam": None})
    with pytest.raises(InputError, match="no table plane"):
        find_table(replace(rendered.frame, depth=rough, camera=camera), rng)


def test_a_wall_is_no_table_where_the_camera_is_calibrated(rendered: Rendered) -> None:
    wall = np.full_like(rendered.frame.depth, 1.0)
    with pytest.raises(InputError, match="no table plane"):
        find_table(replace(rendered.frame, depth=wall), np.random.default_rng(0))


def test_the_sample_scene_has_its_table_at_zero(sample_scene: Path) -> None:
    assert find_table(read_scene(sample_scene), np.random.default_rng(0)).height == pytest.approx(0, abs=0.005)


def test_projected_points_are_where_their_pixels_are() -> None:
    frame, table, _ = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    rows, columns = np.array([20, 90, 150]), np.array([30, 120, 200])
    x, y, depth = project_to_pixels(pixels_to_robot_frame(frame, table, rows, columns), frame.camera, table)
    assert np.allclose(x, columns) and np.allclose(y, rows)
    assert np.allclose(depth, frame.depth[rows, columns])


EYE = (-0.6, 0.0, 1.35)
TOP = 0.5
LOW_TABLE = Thing("box", (0.5, 0.0), (0.5, 0.7, TOP))
ON_IT = (
    Thing("box", (0.45, 0.2), (0.1, 0.12, 0.12), bottom=TOP),
    Thing("cylinder", (0.42, -0.02), (0.08, 0.08, 0.1), bottom=TOP),
    Thing("box", (0.4, -0.2), (0.08, 0.09, 0.08), bottom=TOP),
)


@pytest.fixture(scope="module")
def low_table() -> Rendered:
    """A table of 0.5 m with three things on it, before more floor than table."""
    return render((LOW_TABLE, *ON_IT), eye=EYE)


def table_top(height: float, frame: RGBDFrame) -> RGBDFrame:
    """The frame calibrated, with the robot's z = 0 at ``height`` over the floor."""
    pose = look_at(EYE, (0.5, 0.0, 0.0))
    pose[2, 3] -= height
    return calibrated(frame, pose)


def calibrated(frame: RGBDFrame, pose: np.ndarray) -> RGBDFrame:
    matrix = tuple(tuple(float(value) for value in row) for row in pose)
    return replace(frame, camera=frame.camera.model_copy(update={"T_robot_cam": matrix}))


def test_a_loaded_plane_well_above_the_floor_is_the_table(low_table: Rendered) -> None:
    table = find_table(low_table.frame, np.random.default_rng(0))
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2] - TOP, abs=0.01)
    assert segment_objects_on_table(low_table.frame, table).max() == len(ON_IT)
    floor, top = table.planes
    assert (floor.number, floor.taken, top.number, top.taken) == (1, False, 2, True)
    assert floor.share > top.share
    assert floor.height == pytest.approx(-TOP, abs=0.02)
    assert top.height == pytest.approx(0, abs=0.005)
    assert any("scene.table=1" in one for one in describe_table_doubts(table))


@pytest.mark.parametrize(("choice", "height"), [("largest", 0.0), ("highest", TOP), (1, 0.0), (2, TOP)])
def test_the_user_chooses_the_plane(low_table: Rendered, choice: TableChoice, height: float) -> None:
    table = find_table(low_table.frame, np.random.default_rng(0), choice)
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2] - height, abs=0.01)


def test_a_plane_that_is_not_there_is_refused_with_those_that_are(low_table: Rendered) -> None:
    with pytest.raises(InputError, match=r"scene\.table = 3.* 1 \(.*, 2 \(") as caught:
        find_table(low_table.frame, np.random.default_rng(0), 3)
    assert "auto" in caught.value.remedy


def test_a_bare_plane_above_another_is_no_table() -> None:
    beside = Thing("box", (0.2, 0.0), (0.06, 0.06, 0.1))
    scene = render((Thing("box", (0.6, 0.0), (0.5, 0.7, TOP)), beside), eye=EYE)
    table = find_table(scene.frame, np.random.default_rng(0))
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2], abs=0.01)
    assert any("scene.table=2" in one for one in describe_table_doubts(table))


@pytest.mark.parametrize("height", [0.0, TOP])
def test_calibration_says_which_plane_is_the_table(low_table: Rendered, height: float) -> None:
    table = find_table(table_top(height, low_table.frame), np.random.default_rng(0))
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2] - height, abs=0.005)
    assert table.height == pytest.approx(0, abs=0.005)
    assert not describe_table_doubts(table)


def test_one_table_alone_leaves_no_doubt(rendered: Rendered) -> None:
    table = find_table(rendered.frame, np.random.default_rng(0))
    assert [plane.taken for plane in table.planes] == [True]
    assert not describe_table_doubts(table)


def test_a_tilted_calibration_is_right_under_the_objects(rendered: Rendered) -> None:
    """A degree of tilt about the camera is 15 mm at the table below the objects, and none below the camera."""
    angle = np.deg2rad(1.0)
    tilt = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    pose = np.array(rendered.frame.camera.T_robot_cam)
    pose[:3, :3] = tilt @ pose[:3, :3]
    frame = calibrated(rendered.frame, pose)
    table = find_table(frame, np.random.default_rng(0))
    ground = robot_frame_point_map(frame, table)[(rendered.labels == 0) & (frame.depth > 0)]
    assert float(np.median(ground[:, 2])) == pytest.approx(0, abs=0.003)
    assert segment_objects_on_table(frame, table).max() == len(rendered.things)


def uncalibrated(frame: RGBDFrame) -> RGBDFrame:
    return replace(frame, camera=frame.camera.model_copy(update={"T_robot_cam": None}))


def turned(frame: RGBDFrame, quarters: int) -> RGBDFrame:
    """The frame of a camera rolled by quarter turns; the principal point moves with the picture."""
    camera = frame.camera
    for _ in range(quarters):
        swapped = {"fx": camera.fy, "fy": camera.fx, "cx": camera.cy, "cy": camera.width - 1 - camera.cx}
        camera = camera.model_copy(update={**swapped, "width": camera.height, "height": camera.width})
    rgb, depth = (np.ascontiguousarray(np.rot90(picture, quarters)) for picture in (frame.rgb, frame.depth))
    return replace(frame, rgb=rgb, depth=depth, camera=camera)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_the_table_is_found_wherever_the_camera_stands(low_table: Rendered, quarters: int) -> None:
    frame = turned(low_table.frame, quarters)
    table = find_table(frame, np.random.default_rng(0))
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2] - TOP, abs=0.01)
    assert segment_objects_on_table(frame, table).max() == len(ON_IT)


def test_a_wall_with_more_pixels_is_no_table() -> None:
    boxes = np.concatenate([room.BOXES[[0, 4, 5]], [((0.6, -1.6, -0.8), (0.65, 1.6, 1.2))]])
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.001, boxes)
    assert np.count_nonzero(owner == 3) > np.count_nonzero(owner == 0)
    table = find_table(uncalibrated(frame), np.random.default_rng(0))
    up, true = np.array(table.T_robot_cam)[2], np.array(frame.camera.T_robot_cam)[2]
    assert up == pytest.approx(true, abs=0.02)


def test_a_seat_with_objects_is_the_table_though_the_floor_is_larger() -> None:
    seat = Thing("box", (0.5, 0.0), (0.36, 0.42, 0.45))
    things = [Thing("box", (0.42, y), (0.08, 0.07, 0.09), bottom=0.45) for y in (-0.13, 0.0, 0.13)]
    frame = render((seat, *things), eye=EYE).frame
    table = find_table(frame, np.random.default_rng(0))
    assert table.inliers < 0.12
    assert table.T_robot_cam[2][3] == pytest.approx(EYE[2] - 0.45, abs=0.01)


def test_a_room_without_a_plane_that_carries_objects_is_refused() -> None:
    corner = np.array([((0.9, -3.0, -2.0), (0.95, 0.0, 2.0)), ((0.0, 0.0, -2.0), (0.95, 0.05, 2.0))])
    frame, _, _ = room.photo(room.camera(yaw=0.46, width=640, height=480), 0.001, corner)
    with pytest.raises(InputError, match="no plane carries objects"):
        find_table(uncalibrated(frame), np.random.default_rng(0))


def test_the_measured_vertical_says_which_planes_are_level(rendered: Rendered) -> None:
    up = np.array(rendered.frame.camera.T_robot_cam)[2, :3]
    plain = uncalibrated(rendered.frame)

    def held(vertical: np.ndarray) -> RGBDFrame:
        return replace(
            plain, camera=Camera.model_validate({**plain.camera.model_dump(), "up": tuple(vertical.tolist())})
        )

    table = find_table(held(9.81 * up), np.random.default_rng(0))
    assert np.array(table.T_robot_cam)[2, :3] == pytest.approx(up, abs=0.02)
    with pytest.raises(InputError, match="level by up"):
        find_table(held(rotation_about_axis(np.array([1.0, 0.0, 0.0]), 0.8) @ up), np.random.default_rng(0))


def test_a_pose_in_which_a_bare_wall_is_level_is_blamed() -> None:
    boxes = np.concatenate([room.BOXES[[0, 4, 5]], [((0.7, -1.6, -0.8), (0.75, 1.6, 1.2))]])
    frame, _, _ = room.photo(room.camera(width=640, height=480), 0.001, boxes)
    pose = np.array(frame.camera.T_robot_cam)
    wall_up = pose_matrix(quaternion_to_matrix((0.0, 2**-0.5, 0.0, 2**-0.5)), np.zeros(3)) @ pose
    wall_up[2, 3] += 0.7
    with pytest.raises(InputError, match=r"level in|level by T_robot_cam.*T_robot_cam"):
        find_table(calibrated(frame, wall_up), np.random.default_rng(0))


def inverse(pose: np.ndarray) -> np.ndarray:
    return np.linalg.inv(pose)


def opengl(pose: np.ndarray) -> np.ndarray:
    return pose @ np.diag((1.0, -1.0, -1.0, 1.0))


def view_matrix(pose: np.ndarray) -> np.ndarray:
    return inverse(opengl(pose))


def scalar_first_as_last(pose: np.ndarray) -> np.ndarray:
    x, y, z, w = matrix_to_quaternion(pose[:3, :3])
    return pose_matrix(quaternion_to_matrix((w, x, y, z)), pose[:3, 3])


def scalar_last_as_first(pose: np.ndarray) -> np.ndarray:
    x, y, z, w = matrix_to_quaternion(pose[:3, :3])
    return pose_matrix(quaternion_to_matrix((y, z, w, x)), pose[:3, 3])


@pytest.mark.parametrize(
    ("mistake", "words", "remedy"),
    [
        (scalar_first_as_last, "quaternion wxyz that was read as xyzw", "order of the quaternion"),
        (scalar_last_as_first, "quaternion xyzw that was read as wxyz", "order of the quaternion"),
        (inverse, "is the inverse, from the robot frame", "give its inverse"),
        (opengl, "has OpenGL's camera axes", "negate its second and third columns"),
        (view_matrix, "view matrix", "inverse with the second and third columns negated"),
    ],
)
def test_the_usual_mistake_in_a_calibration_is_named(
    rendered: Rendered, mistake: Callable[[np.ndarray], np.ndarray], words: str, remedy: str
) -> None:
    wrong = mistake(np.array(rendered.frame.camera.T_robot_cam))
    with pytest.raises(InputError, match=words) as caught:
        find_table(calibrated(rendered.frame, wrong), np.random.default_rng(0))
    assert remedy in caught.value.remedy


def test_a_calibration_that_no_usual_mistake_explains_is_only_refused(rendered: Rendered) -> None:
    pose = np.array(rendered.frame.camera.T_robot_cam)
    pose[2, 3] += 0.4
    with pytest.raises(InputError, match=r"z = \+0\.4") as caught:
        find_table(calibrated(rendered.frame, pose), np.random.default_rng(0))
    assert "probably" not in str(caught.value)
    assert "T_robot_cam is at fault" in str(caught.value)


def test_a_calibration_that_leans_is_blamed_and_not_the_photo(rendered: Rendered) -> None:
    pose = np.array(rendered.frame.camera.T_robot_cam)
    pose[:3, :3] = rotation_about_axis(np.array([0.6, 0.8, 0.0]), 0.9) @ pose[:3, :3]
    with pytest.raises(InputError, match=r"T_robot_cam is at fault: without it a plane with \d+%.*tilted by 5[12] deg"):
        find_table(calibrated(rendered.frame, pose), np.random.default_rng(0))


def distance_along_ray(frame: RGBDFrame) -> np.ndarray:
    return np.linalg.norm(frame.camera_frame_point_map(), axis=2)


def disparity(frame: RGBDFrame) -> np.ndarray:
    return np.divide(0.8, frame.depth, out=np.zeros_like(frame.depth), where=frame.depth > 0)


@pytest.mark.parametrize(("record", "words"), [(distance_along_ray, "distance along the ray"), (disparity, "inverse")])
def test_what_is_no_depth_along_the_axis_is_named(
    rendered: Rendered, record: Callable[[RGBDFrame], np.ndarray], words: str
) -> None:
    plain = rendered.frame
    frame = replace(plain, camera=plain.camera.model_copy(update={"T_robot_cam": None}))
    find_table(frame, np.random.default_rng(0))
    with pytest.raises(InputError, match=f"depth is probably.*{words}"):
        find_table(replace(frame, depth=record(frame).astype(np.float32)), np.random.default_rng(0))
