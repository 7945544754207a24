"""A bin: four walls around everything that lies on the table."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from evals.synthesis.built_asset import build_asset, write_assets
from evals.synthesis.colliders import open_box
from grs_agents.base import Pose
from grs_agents.library.asset import Asset
from grs_agents.library.shapes import Rgba

WALLS = "bin/walls.urdf"
_MARGIN = (0.01, 0.07)
"""Distance between objects and walls, m."""
_HEIGHT = (0.05, 0.14)
_THICKNESS = (0.004, 0.018)
_NEAREST = 0.13
"""The walls stay as far (m) in front of the middle of the robot's base."""


def write_bin_walls(root: Path, around: npt.NDArray[np.float64], rng: np.random.Generator) -> Pose:
    """Write walls around objects into the library folder ``root``, as the asset `WALLS`.

    Args:
        root: of a separate library.
        around: (2, 2) lowest and highest x, y (m, robot frame) of the objects.
        rng: source of distances, height, thickness and colour.

    Returns:
        Their pose.
    """
    thick, height = float(rng.uniform(*_THICKNESS)), float(rng.uniform(*_HEIGHT))
    room = rng.uniform(*_MARGIN, (2, 2)) + thick
    low, high = around[0] - room[0], around[1] + room[1]
    low[0] = max(low[0], min(_NEAREST, around[0, 0] - thick - _MARGIN[0]))
    x, y = (float(value) for value in high - low)
    grey, tint = float(rng.uniform(0.15, 0.9)), rng.uniform(0.8, 1.0, 3)
    color: Rgba = (grey * float(tint[0]), grey * float(tint[1]), grey * float(tint[2]), 1.0)
    _, *walls = open_box((x, y, height), thick, color)
    asset = Asset(
        name=WALLS,
        kind="walls",
        category="container",
        size=(x, y, height),
        mass=1.0,
        friction=0.6,
        color="unknown",
        description="the walls of a bin",
        hollow=True,
        fixture=True,
    )
    write_assets(root, [build_asset(asset, walls, walls)])
    middle = (low + high) / 2
    return (float(middle[0]), float(middle[1]), height / 2), (0.0, 0.0, 0.0, 1.0)
