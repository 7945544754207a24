"""How much of what the photo shows the twin shows at the same depth."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library import Library
from grs_agents.perception.frame import Mask, RGBDFrame
from grs_agents.perception.settling.placed_object import Thing
from grs_agents.perception.settling.settling import instances, on_table
from grs_agents.perception.types import TableFrame
from grs_agents.sim.world.rendering import Sight, cast

NEAR = 0.02
"""A pixel is right within this depth, m."""
RAYS = 20_000
"""At most so many pixels are compared, evenly drawn."""


def fidelity(
    things: Sequence[Thing], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float | None:
    """The share of the measured pixels of ``mask`` (H, W) at which the things, seen by the photo's camera, are right.

    ``None`` if nothing is measured there.

    Raises:
        UnknownNameError: an asset is not in the library.
        SimulationError: MuJoCo takes the scene for impossible.
    """
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    if not len(rows):
        return None
    step = -(-len(rows) // RAYS)
    rows, columns = rows[::step], columns[::step]
    camera, pose = frame.camera, np.asarray(table.T_robot_cam)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=-1)
    directions = np.asarray((local @ pose[:3, :3].T)[None], np.float64)
    sight = Sight(instances([one for one in things if on_table(one)], library), library)
    picture = cast(sight, pose[:3, 3].copy(), directions)
    off = np.abs(picture.depth[0] - frame.depth[rows, columns])
    return float(((off <= NEAR) & (picture.owner[0] >= 0)).mean())
