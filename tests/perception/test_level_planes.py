"""Planes that least squares tilts out of level are no candidates for the table."""

import numpy as np

from grs_agents.perception.plane_fitting import find_level_planes

UP = np.array([0.0, 0.0, -1.0])


def ramp(degrees: float, height: float, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) of a square of 0.8 m that a camera 1.5 m above the floor sees from above, tilted about y, m."""
    x, y = rng.uniform(-0.4, 0.4, (2, 20_000))
    z = 1.5 - height - np.tan(np.radians(degrees)) * x
    return np.column_stack([x, y, z + rng.normal(0, 0.001, x.size)])


def test_a_ramp_beside_the_floor_is_no_level_plane() -> None:
    rng = np.random.default_rng(0)
    floor = np.column_stack([*rng.uniform(-1.2, 1.2, (2, 60_000)), np.full(60_000, 1.5)])

    def count(degrees: float) -> int:
        return len(find_level_planes(np.vstack([floor, ramp(degrees, 0.7, rng)]), UP, np.random.default_rng(1)))

    assert count(4.0) == 2
    assert count(13.0) == 1
