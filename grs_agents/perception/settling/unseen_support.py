"""What stands on something the photo does not show: nothing that is at rest in a photo hangs in the air."""

import cv2
import numpy as np

from grs_agents.library import Library
from grs_agents.perception.configuration import DEFAULT, UnseenSupport
from grs_agents.perception.image_geometry import hull_of
from grs_agents.perception.proxies.free_space_grid import observed_free
from grs_agents.perception.registration.asset_surfaces import asset_surface_at
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import RGBDFrame, TableFrame


def may_have_unseen_support(
    placed: PlacedObject,
    library: Library,
    frame: RGBDFrame,
    table: TableFrame,
    config: UnseenSupport = DEFAULT.support,
) -> bool:
    """Whether columns from the table to its underside, of which the photo shows none to be free, could carry it.

    Raises:
        UnknownNameError: the asset is not in the library.
    """
    surface = asset_surface_at(placed.asset, placed.pose, library)
    under = surface.points[surface.normals[:, 2] < config.downward]
    if not len(under):
        return False
    columns = under[:, None] * (1, 1, 0) + under[:, None, 2:] * np.reshape(config.levels, (-1, 1)) * (0, 0, 1)
    shown = observed_free(columns.reshape(-1, 3), frame, table).reshape(len(under), len(config.levels)).mean(axis=1)
    carried = under[(shown <= config.shown) | (under[:, 2] < config.on_table)]
    hull = hull_of(carried).astype(np.float32)
    x, y, _ = placed.pose[0]
    return len(hull) > 2 and cv2.pointPolygonTest(hull, (x, y), measureDist=False) >= 0
