"""Settle a described scene, compare it with its photo, and say how both went.
The comparison counts how much of what the photo shows the twin shows at the same depth."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import pixels_in_mask
from grs_agents.perception.settling.settling import (
    PlacedObject,
    RestState,
    is_over_table,
    settle_objects,
    to_instance_objects,
)
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, TwinReport
from grs_agents.sim.rendering.plain_pictures import render_along_rays
from grs_agents.sim.rendering.views import VisibleScene

CONFIG = DEFAULT.settling


def measure_depth_fidelity(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float | None:
    """The share of the measured pixels of ``mask`` (H, W) at which the objects have the photo's depth, if any are."""
    rows, columns = pixels_in_mask(mask & (frame.depth > 0))
    if not len(rows):
        return None
    step = -(-len(rows) // CONFIG.rays)
    rows, columns = rows[::step], columns[::step]
    camera, pose = frame.camera, np.asarray(table.T_robot_cam)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=-1)
    directions = np.asarray((local @ pose[:3, :3].T)[None], np.float64)
    sight = VisibleScene(to_instance_objects([placed for placed in objects if is_over_table(placed)], library), library)
    picture = render_along_rays(sight, pose[:3, 3].copy(), directions)
    off = np.abs(picture.depth[0] - frame.depth[rows, columns])
    return float(((off <= CONFIG.near) & (picture.owner[0] >= 0)).mean())


def settle_and_measure_fidelity(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> tuple[RestState, TwinReport]:
    """The scene at rest, and its figures; ``mask`` (H, W) are the pixels that rise above the table."""
    rest = settle_objects(objects, library)
    pairs = zip(objects, rest.placed, strict=True)
    resting = [one if placed is None else PlacedObject(one.asset, placed.pose) for one, placed in pairs]
    held = sum(placed.held for placed in rest.placed if placed is not None)
    fidelity = measure_depth_fidelity(resting, library, frame, table, mask)
    drift, still = rest.largest_drift, rest.still
    return rest, TwinReport(
        found=rest.found, penetration=rest.penetration, drift=drift, fidelity=fidelity, still=still, held=held
    )
