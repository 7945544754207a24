"""What stands on the table, and nothing else."""

from dataclasses import replace

import numpy as np

from grs_agents.perception.segmentation.patch_cutting import find_depth_jumps, foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from tests.perception.conftest import Rendered, Thing, render


def _foreground(scene: Rendered) -> np.ndarray:
    smooth = smooth_frame_depth(scene.frame)
    table = find_table(scene.frame, np.random.default_rng(0))
    return foreground_pixel_mask(robot_frame_point_map(smooth, table), smooth, np.asarray(table.T_robot_cam)[:3, 3])


def test_the_foreground_is_the_things(rendered: Rendered) -> None:
    found, truth = _foreground(rendered), rendered.labels > 0
    assert (found & truth).sum() > 0.85 * (found | truth).sum()  # a floor of 5 mm counts as table here


def test_a_table_that_things_cut_into_pieces_stays_one() -> None:
    wall = [Thing("box", (0.45, 0.1 * i), (0.05, 0.098, 0.12)) for i in range(-4, 5)]
    scene = render([*wall, Thing("box", (0.75, 0.1), (0.08, 0.08, 0.1))])
    found = _foreground(scene)
    assert found[scene.labels == 10].mean() > 0.9


def test_a_heap_that_hides_half_a_metre_of_the_table_leaves_it_one() -> None:
    wall = [Thing("box", (0.4, 0.1 * i), (0.16, 0.098, 0.25)) for i in range(-7, 8)]
    scene = render([*wall, Thing("box", (1.0, 0.1), (0.08, 0.08, 0.1))])
    found = _foreground(scene)
    assert found[scene.labels == len(wall) + 1].mean() > 0.9


def test_another_table_of_the_same_height_is_left_out_where_the_gap_is_seen() -> None:
    tables = [Thing("box", (0.35, 0.0), (0.4, 0.9, 0.5)), Thing("box", (0.83, 0.0), (0.3, 0.9, 0.5))]
    on_them = [
        Thing("box", (0.4, 0.1), (0.1, 0.1, 0.1), bottom=0.5),
        Thing("box", (0.85, 0.0), (0.1, 0.1, 0.1), bottom=0.5),
    ]
    scene = render([*tables, *on_them], eye=(-0.6, 0.0, 1.35))
    found = _foreground(scene)
    assert found[scene.labels == 3].mean() > 0.9
    assert found[scene.labels == 4].mean() < 0.05


def test_what_lies_beyond_the_table_is_left_out() -> None:
    scene = render([Thing("box", (0.5, 0.0), (0.1, 0.1, 0.1)), Thing("box", (1.5, 0.0), (0.3, 0.9, 0.3))])
    found = _foreground(scene)
    assert found[scene.labels == 1].mean() > 0.9
    assert found[scene.labels == 2].mean() < 0.05


def test_small_holes_are_filled(rendered: Rendered) -> None:
    depth = rendered.frame.depth.copy()
    depth[200:202, 200:202] = 0
    frame = type(rendered.frame)(rendered.frame.rgb, depth, rendered.frame.camera, rendered.frame.source)
    assert (smooth_frame_depth(frame).depth[200:202, 200:202] > 0).all()


def test_jumps_lie_between_surfaces() -> None:
    depth = np.ones((4, 6), np.float32)
    depth[:, 3:] = 1.2
    below, right = find_depth_jumps(depth)
    assert not below.any()
    assert right[:, 2].all()
    assert right.sum() == 4


def test_an_object_that_touches_a_leaning_wall_is_not_lost_with_it() -> None:
    scene = render([Thing("box", (0.72, 0.1), (0.1, 0.1, 0.12))], noise=0.0005, calibrated=True)
    camera = scene.frame.camera
    pose, (rows, columns) = np.asarray(camera.T_robot_cam), np.indices(scene.frame.depth.shape)
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], axis=-1)
    rays = rays @ pose[:3, :3].T
    # The plane x - 0.7 = z: a side of a bin.
    wall = (0.7 + pose[2, 3] - pose[0, 3]) / np.maximum(rays[..., 0] - rays[..., 2], 1e-6)
    behind = wall < scene.frame.depth
    frame = replace(scene.frame, depth=np.where(behind, wall, scene.frame.depth).astype(np.float32))
    found = _foreground(replace(scene, frame=frame))
    assert found[(scene.labels == 1) & ~behind].mean() > 0.6
    assert found[behind & (rays[..., 0] > 0)].mean() < 0.05
