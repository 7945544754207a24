"""What stands around an object of unknown shape, and so is not its own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.proxies.meshes import inside_colliders_mask
from grs_agents.perception.types import Array, Mask


@dataclass(frozen=True)
class Surroundings:
    """Known objects where they stand."""

    # names of assets, each with the pose of the centre of its bounding box (m, xyzw), robot frame
    known: Sequence[tuple[str, Pose]]
    library: Library  # where the assets are looked up

    def occupied_points_mask(self, points: Array, margin: float = 0.0) -> Mask:
        """(N,) which of points (N, 3), m, robot frame, are taken, or less than ``margin`` m from a known object."""
        taken = np.zeros(len(points), np.bool_)
        for asset, (position, orientation) in self.known:
            model = self.library.load_object_model(asset)
            low, high = np.array(model.bounds)
            near = np.flatnonzero(np.linalg.norm(points - position, axis=1) < np.linalg.norm(high - low) / 2 + margin)
            if len(near):
                local = (points[near] - position) @ matrix_from_quaternion(orientation) + (low + high) / 2
                taken[near] |= inside_colliders_mask(model, self.library, local, margin)
        return taken
