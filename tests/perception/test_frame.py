"""Frames: pixels become points."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.perception.types import Camera, RGBDFrame
from tests.perception.conftest import Rendered


@given(row=st.integers(0, 23), column=st.integers(0, 31), depth=st.floats(0.2, 5.0))
def test_points_project_back_to_their_pixels(row: int, column: int, depth: float) -> None:
    camera = Camera(fx=40.0, fy=50.0, cx=15.5, cy=11.5, width=32, height=24, depth_scale=0.001)
    picture = np.zeros((24, 32), np.float32)
    picture[row, column] = depth
    frame = RGBDFrame(np.zeros((24, 32, 3), np.uint8), picture, camera, Path("x"))
    x, y, z = frame.camera_frame_point_map()[row, column]
    assert (x / z * 40 + 15.5, y / z * 50 + 11.5, z) == pytest.approx((column, row, depth), rel=1e-5, abs=1e-4)


def test_pixels_without_depth_are_at_the_origin(rendered: Rendered) -> None:
    points = rendered.frame.camera_frame_point_map()
    assert not points[rendered.frame.depth == 0].any()
