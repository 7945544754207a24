"""The air that a photo shows."""

import numpy as np

from grs_agents.perception.proxies.free_space import observed_free_points_mask
from tests.perception.settling.photo import LIBRARY, MILK, photo_of, standing


def test_the_air_is_free_and_what_is_hidden_is_not_said_to_be() -> None:
    frame, table, _ = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    before, within, behind, above = (0.4, 0.0, 0.05), (0.5, 0.0, 0.05), (0.6, 0.0, 0.05), (0.5, 0.0, 0.22)
    assert observed_free_points_mask(np.array([before, within, behind, above]), frame, table).tolist() == [
        True,
        False,
        False,
        True,
    ]


def test_nothing_is_said_of_what_the_camera_does_not_see() -> None:
    frame, table, _ = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    behind_the_camera, beside_the_picture = (-1.0, 0.0, 1.2), (0.5, 3.0, 0.05)
    assert not observed_free_points_mask(np.array([behind_the_camera, beside_the_picture]), frame, table).any()
    unmeasured = frame.depth.copy()
    unmeasured[:] = 0
    blind = type(frame)(frame.rgb, unmeasured, frame.camera, frame.source)
    assert not observed_free_points_mask(np.array([(0.5, 0.0, 0.22)]), blind, table).any()
