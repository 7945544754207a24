"""Noise of the sensor on a bare table is no object."""

import numpy as np
import pytest

from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from tests.perception.conftest import Thing, render


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
def test_noise_is_no_object(noise: float) -> None:
    scene = render((Thing("box", (0.45, 0.0), (0.06, 0.06, 0.08)),), noise=noise, calibrated=True)
    table = find_table(scene.frame, np.random.default_rng(0))
    assert segment_objects_on_table(scene.frame, table).max() == 1
