"""The residual of a pose is a trimmed mean: stray points on an object do not move it."""

from typing import Any, cast

import numpy as np

from grs_agents.perception.asset_surfaces import SurfaceSamples, Tree
from grs_agents.perception.registration.pose_cost import ObservedPoints, residual_per_pose


def test_a_twentieth_of_stray_points_leaves_the_residual_as_it_is() -> None:
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 41), np.linspace(-0.05, 0.05, 41))
    plate = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    surface = SurfaceSamples(plate, np.tile([0.0, 0.0, 1.0], (len(plate), 1)), np.array([0.05, 0.05, 0.0]), 0.0025)
    seen = plate + np.array([0.0, 0.0, 0.001])
    stray = seen.copy()
    stray[::20, 2] += 0.03
    nothing = cast(Any, None)

    def residual(points: np.ndarray) -> float:
        poses = np.eye(4)[None]
        return float(residual_per_pose(surface, Tree(plate), poses, ObservedPoints(points, nothing, nothing))[0])

    assert abs(residual(seen) - 0.001) < 1e-6
    assert abs(residual(stray) - 0.001) < 1e-6
