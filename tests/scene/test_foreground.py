"""What stands on the table, and nothing else."""

import numpy as np

from grs_agents.scene import find_table
from grs_agents.scene.foreground import foreground, jumps, smoothed
from grs_agents.scene.table import robot_points
from tests.scene.conftest import Rendered, Thing, render


def _foreground(scene: Rendered) -> np.ndarray:
    smooth = smoothed(scene.frame)
    table = find_table(scene.frame, np.random.default_rng(0))
    return foreground(robot_points(smooth, table), smooth.depth, np.asarray(table.T_robot_cam)[:3, 3])


def test_the_foreground_is_the_things(rendered: Rendered) -> None:
    found, truth = _foreground(rendered), rendered.labels > 0
    assert (found & truth).sum() > 0.85 * (found | truth).sum()  # a floor of 5 mm counts as table here


def test_a_table_that_things_cut_into_pieces_stays_one() -> None:
    wall = [Thing("box", (0.45, 0.1 * i), (0.05, 0.098, 0.12)) for i in range(-4, 5)]
    scene = render([*wall, Thing("box", (0.75, 0.1), (0.08, 0.08, 0.1))])
    found = _foreground(scene)
    assert found[scene.labels == 10].mean() > 0.9


def test_what_lies_beyond_the_table_is_left_out() -> None:
    scene = render([Thing("box", (0.5, 0.0), (0.1, 0.1, 0.1)), Thing("box", (1.5, 0.0), (0.3, 0.9, 0.3))])
    found = _foreground(scene)
    assert found[scene.labels == 1].mean() > 0.9
    assert found[scene.labels == 2].mean() < 0.05


def test_small_holes_are_filled(rendered: Rendered) -> None:
    depth = rendered.frame.depth.copy()
    depth[200:202, 200:202] = 0
    frame = type(rendered.frame)(rendered.frame.rgb, depth, rendered.frame.camera, rendered.frame.source)
    assert (smoothed(frame).depth[200:202, 200:202] > 0).all()


def test_jumps_lie_between_surfaces() -> None:
    depth = np.ones((4, 6), np.float32)
    depth[:, 3:] = 1.2
    below, right = jumps(depth)
    assert not below.any()
    assert right[:, 2].all()
    assert right.sum() == 4
