"""Pictures obey the camera."""

import numpy as np
import pytest

from grs_agents.library import Library
from grs_agents.library.posed_meshes import PlacedAsset, placed_triangles
from scripts.assets.picture import View, picture

VIEW = View(160, 120, 150.0, eye=(1.2, 0.0, 0.8), target=(0.5, 0.0, 0.0))


def test_depth_and_labels_agree_with_the_camera() -> None:
    shot = picture(
        placed_triangles([PlacedAsset("block/red_block.urdf", 0.5, 0.0)], Library()), VIEW, np.random.default_rng(0)
    )
    rows, columns = np.nonzero(shot.labels)
    assert 20 < len(rows) < 400
    (cx, cy), matrix = VIEW.centre(), VIEW.camera_to_robot()
    depth = shot.depth[rows, columns]
    local = np.stack([(columns - cx) / VIEW.focal * depth, (rows - cy) / VIEW.focal * depth, depth], 1)
    points = local @ matrix[:3, :3].T + matrix[:3, 3]
    assert points.min(axis=0) == pytest.approx((0.48, -0.02, 0.0), abs=0.01)
    assert points.max(axis=0) == pytest.approx((0.52, 0.02, 0.04), abs=0.01)
    again = picture(
        placed_triangles([PlacedAsset("block/red_block.urdf", 0.5, 0.0)], Library()), VIEW, np.random.default_rng(0)
    )
    assert (again.rgb == shot.rgb).all()
    red = shot.rgb[rows, columns].mean(axis=0)
    assert red[0] > 2 * red[1]


def test_the_camera_frame_is_a_rotation_that_looks_at_its_target() -> None:
    matrix = VIEW.camera_to_robot()
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3))
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    ahead = np.subtract(VIEW.target, VIEW.eye)
    assert np.allclose(matrix[:3, 2], ahead / np.linalg.norm(ahead))
    assert matrix[2, 1] < 0, "y points down"
