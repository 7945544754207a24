"""Things that are lower than the bound for one pixel, but lie free."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from tests.perception.conftest import Thing, render

ONE_BY_ONE = DEFAULT.segmentation.without_rules("low_thing")


@settings(max_examples=8, deadline=None)
@given(
    x=st.floats(0.4, 0.5), y=st.floats(-0.08, 0.08), height=st.floats(0.0053, 0.0057), along=st.booleans()
)  # at 1 m a single pixel must be 6 mm high
def test_a_ruler_that_lies_free_is_an_object(x: float, y: float, height: float, along: bool) -> None:
    size = (0.14, 0.022, height) if along else (0.022, 0.14, height)
    scene = render((Thing("box", (x, y), size),), noise=0.0003, calibrated=True)
    table = find_table(scene.frame, np.random.default_rng(0))
    labels = segment_objects_on_table(scene.frame, table)
    assert not segment_objects_on_table(scene.frame, table, ONE_BY_ONE).any(), "its pixels are too low one by one"
    assert labels.max() == 1
    points = scene.frame.camera_frame_point_map()[labels > 0]
    seen = points @ np.asarray(table.T_robot_cam)[:3, :3].T + np.asarray(table.T_robot_cam)[:3, 3]
    np.testing.assert_allclose(np.median(seen[:, :2], axis=0), (x, y), atol=0.012)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
def test_noise_and_a_bare_table_are_no_low_things(noise: float) -> None:
    scene = render((Thing("box", (0.45, 0.0), (0.06, 0.06, 0.08)),), noise=noise, calibrated=True)
    table = find_table(scene.frame, np.random.default_rng(0))
    assert segment_objects_on_table(scene.frame, table).max() == 1
