"""Noise of the sensor on a bare table is no object."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.segmentation.segmentation import find_table_noise, segment_objects_on_table
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from tests.perception.conftest import Thing, render


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
def test_noise_is_no_object(noise: float) -> None:
    scene = render((Thing("box", (0.45, 0.0), (0.06, 0.06, 0.08)),), noise=noise, calibrated=True)
    table = find_table(scene.frame, np.random.default_rng(0))
    assert segment_objects_on_table(scene.frame, table).max() == 1


@pytest.mark.parametrize(("color", "objects"), [((150, 140, 130), 1), ((40, 70, 150), 2)], ids=["table", "blue"])
def test_what_is_as_low_as_noise_is_an_object_if_it_looks_otherwise(color: tuple[int, int, int], objects: int) -> None:
    scene = render((Thing("box", (0.6, 0.1), (0.06, 0.06, 0.08)), Thing("box", (0.4, 0.0), (0.04, 0.04, 0.0115))), 0.0)
    rgb = scene.frame.rgb.copy()
    rgb[scene.labels == 2] = color
    table = find_table(scene.frame, np.random.default_rng(0))
    assert segment_objects_on_table(replace(scene.frame, rgb=rgb), table).max() == objects


def test_the_low_foot_of_an_object_is_no_object() -> None:
    foot = Thing("box", (0.45, 0.0), (0.05, 0.05, 0.0115))
    scene = render((Thing("box", (0.5, 0.07), (0.06, 0.06, 0.08)), foot), 0.0)
    rgb = np.where(scene.labels[..., None] > 0, np.uint8(240), scene.frame.rgb)
    table = find_table(scene.frame, np.random.default_rng(0))
    assert segment_objects_on_table(replace(scene.frame, rgb=rgb), table).max() == 1


@pytest.mark.parametrize(
    ("color", "width", "noise"), [((150, 140, 130), 8, {1}), ((40, 70, 150), 8, set()), ((150, 140, 130), 14, set())]
)
def test_a_narrow_piece_of_the_colors_of_the_table_is_mixed_depth(
    color: tuple[int, int, int], width: int, noise: set[int]
) -> None:
    scene = render((), 0.0)
    table = find_table(scene.frame, np.random.default_rng(0))
    labels, points = np.zeros_like(scene.labels), robot_frame_point_map(scene.frame, table)
    labels[160:195, 200 : 200 + width] = 1
    points[labels > 0, 2] = 0.1
    rgb = scene.frame.rgb.copy()
    rgb[labels > 0] = color
    assert find_table_noise(labels, points, rgb, table) == noise
