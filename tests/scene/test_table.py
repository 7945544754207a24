"""The table's plane and the frame laid on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grs_agents.errors import InputError
from grs_agents.scene import find_table, read_scene
from grs_agents.scene.table import projected, robot_points, robot_points_at
from tests.scene.conftest import Rendered, Thing, render
from tests.twin.photo import LIBRARY, MILK, photo_of, standing


def test_a_calibrated_frame_is_kept(rendered: Rendered) -> None:
    table = find_table(rendered.frame, np.random.default_rng(0))
    assert table.origin == "calibrated"
    assert table.height == pytest.approx(0, abs=0.002)
    assert np.allclose(table.T_robot_cam, rendered.frame.camera.T_robot_cam, atol=0.002)


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
    points = robot_points(rendered.frame, find_table(rendered.frame, np.random.default_rng(0)))
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
    x, y, depth = projected(robot_points_at(frame, table, rows, columns), frame.camera, table)
    assert np.allclose(x, columns) and np.allclose(y, rows)
    assert np.allclose(depth, frame.depth[rows, columns])
