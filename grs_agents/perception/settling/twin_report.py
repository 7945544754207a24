"""Settle a described scene, compare it with its photo, and say how both went.

The comparison counts how much of what the photo shows the twin shows at the same depth.
"""

from collections.abc import Sequence

import numpy as np

from grs_agents.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.settling.settling import PlacedObject, RestState, instances, on_table, settle
from grs_agents.perception.settling.unseen_support import may_have_unseen_support
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, TwinReport
from grs_agents.sim.world.rendering import VisibleScene, cast_rays

CONFIG = DEFAULT.settling


def fidelity(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float | None:
    """The share of the measured pixels of ``mask`` (H, W) at which the objects have the photo's depth, if any are."""
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    if not len(rows):
        return None
    step = -(-len(rows) // CONFIG.rays)
    rows, columns = rows[::step], columns[::step]
    camera, pose = frame.camera, np.asarray(table.T_robot_cam)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=-1)
    directions = np.asarray((local @ pose[:3, :3].T)[None], np.float64)
    sight = Sight(instances([placed for placed in objects if on_table(placed)], library), library)
    picture = cast(sight, pose[:3, 3].copy(), directions)
    off = np.abs(picture.depth[0] - frame.depth[rows, columns])
    return float(((off <= CONFIG.near) & (picture.owner[0] >= 0)).mean())


def report_of(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> tuple[RestState, TwinReport]:
    """The scene at rest, and its figures; ``mask`` (H, W) are the pixels of all objects."""
    rest = settle(objects, library, lambda placed: may_have_unseen_support(placed, library, frame, table))
    resting = [
        described if placed is None else PlacedObject(described.asset, placed.pose)
        for described, placed in zip(objects, rest.placed, strict=True)
    ]
    return rest, TwinReport(
        found=rest.found,
        penetration=rest.penetration,
        drift=rest.farthest,
        fidelity=fidelity(resting, library, frame, table, mask),
        still=rest.still,
        held=sum(placed.held for placed in rest.placed if placed is not None),
    )
