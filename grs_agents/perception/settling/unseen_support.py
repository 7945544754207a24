"""What stands on something the photo does not show: nothing that is at rest in a photo hangs in the air."""

import cv2
import numpy as np

from grs_agents.library import Library
from grs_agents.perception.image_geometry import hull_of
from grs_agents.perception.proxies.free_space_map import observed_free
from grs_agents.perception.registration.surface_inliers import asset_surface_at
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import RGBDFrame, TableFrame

DOWNWARD = -0.3
"""Faces whose normals point lower than this belong to an underside."""
ON_TABLE = 0.005
"""What of an underside is lower than this (m) touches the table."""
LEVELS = (0.1, 0.35, 0.6, 0.85)
"""A column below an underside is looked at in so many heights, as shares of its own."""
SHOWN = 0.25
"""A column of which more than this share is shown to be free is no support."""


def may_have_unseen_support(thing: PlacedObject, library: Library, frame: RGBDFrame, table: TableFrame) -> bool:
    """Whether columns from the table to its underside, of which the photo shows none to be free, could carry it.

    Raises:
        UnknownNameError: the asset is not in the library.
    """
    shell = asset_surface_at(thing.asset, thing.pose, library)
    under = shell.points[shell.normals[:, 2] < DOWNWARD]
    if not len(under):
        return False
    columns = under[:, None] * (1, 1, 0) + under[:, None, 2:] * np.reshape(LEVELS, (-1, 1)) * (0, 0, 1)
    shown = observed_free(columns.reshape(-1, 3), frame, table).reshape(len(under), len(LEVELS)).mean(axis=1)
    carried = under[(shown <= SHOWN) | (under[:, 2] < ON_TABLE)]
    hull = hull_of(carried).astype(np.float32)
    x, y, _ = thing.pose[0]
    return len(hull) > 2 and cv2.pointPolygonTest(hull, (x, y), measureDist=False) >= 0
