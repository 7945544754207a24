"""What is measured of a thing of unknown shape is its own."""

import numpy as np

from grs_agents.perception import Surroundings, UprightBox
from grs_agents.perception.proxies import measure_shape
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing


def test_points_on_a_known_thing_tell_nothing_of_another_ones_shape() -> None:
    milk, block = standing(MILK, 0.55, 0.0), standing(BLOCK, 0.46, 0.02)
    frame, table, mask = photo_of([milk, block], LIBRARY)
    box = UprightBox(center=(0.5, 0.01, 0.1), size=(0.2, 0.15, 0.2), yaw=0.0)
    joined = measure_shape(frame, table, mask, box)
    own = measure_shape(frame, table, mask, box, Surroundings([(milk.asset, milk.pose)], (), LIBRARY))
    low = block.pose[0][2] + 0.02 - box.center[2]
    assert (joined.points[:, 2] > low + 0.02).mean() > 0.3
    assert len(own.points) >= 50 and (own.points[:, 2] > low + 0.02).mean() < 0.1
    assert own.crowded and not joined.crowded


def test_what_lies_wholly_on_a_known_thing_keeps_its_points() -> None:
    milk = standing(MILK, 0.55, 0.0)
    frame, table, mask = photo_of([milk], LIBRARY)
    box = UprightBox(center=milk.pose[0], size=(0.08, 0.08, 0.2), yaw=0.0)
    found = measure_shape(frame, table, mask, box, Surroundings([(milk.asset, milk.pose)], (), LIBRARY))
    assert len(found.points) == len(measure_shape(frame, table, mask, box).points)
    assert np.isfinite(found.points).all()
