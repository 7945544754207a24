"""Settle a described scene, compare it with its photo, and say how both went.
The comparison counts how much of what the photo shows the twin shows at the same depth."""

from collections.abc import Sequence

import cv2
import numpy as np

from grs_agents.library import Library
from grs_agents.perception.asset_surfaces import asset_surface_at_pose
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import convex_footprint_hull
from grs_agents.perception.proxies import observed_free_points_mask
from grs_agents.perception.settling.settling import (
    PlacedObject,
    RestState,
    is_over_table,
    settle_objects,
    to_instance_objects,
)
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, TwinReport
from grs_agents.sim.rendering import VisibleScene, render_along_rays

CONFIG, SUPPORT = DEFAULT.settling, DEFAULT.support


def measure_depth_fidelity(
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
    sight = VisibleScene(to_instance_objects([placed for placed in objects if is_over_table(placed)], library), library)
    picture = render_along_rays(sight, pose[:3, 3].copy(), directions)
    off = np.abs(picture.depth[0] - frame.depth[rows, columns])
    return float(((off <= CONFIG.near) & (picture.owner[0] >= 0)).mean())


def settle_and_report(
    objects: Sequence[PlacedObject], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> tuple[RestState, TwinReport]:
    """The scene at rest, and its figures; ``mask`` (H, W) are the pixels of all objects."""
    rest = settle_objects(objects, library, lambda placed: may_have_unseen_support(placed, library, frame, table))
    pairs = zip(objects, rest.placed, strict=True)
    resting = [one if placed is None else PlacedObject(one.asset, placed.pose) for one, placed in pairs]
    held = sum(placed.held for placed in rest.placed if placed is not None)
    fidelity = measure_depth_fidelity(resting, library, frame, table, mask)
    drift, still = rest.largest_drift, rest.still
    return rest, TwinReport(
        found=rest.found, penetration=rest.penetration, drift=drift, fidelity=fidelity, still=still, held=held
    )


def may_have_unseen_support(placed: PlacedObject, library: Library, frame: RGBDFrame, table: TableFrame) -> bool:
    """Whether columns from the table to its underside, of which the photo shows none to be free, could carry it."""
    surface = asset_surface_at_pose(placed.asset, placed.pose, library)
    under = surface.points[surface.normals[:, 2] < SUPPORT.downward]
    if not len(under):
        return False
    columns = under[:, None] * (1, 1, 0) + under[:, None, 2:] * np.reshape(SUPPORT.levels, (-1, 1)) * (0, 0, 1)
    free = observed_free_points_mask(columns.reshape(-1, 3), frame, table)
    shown = free.reshape(len(under), len(SUPPORT.levels)).mean(axis=1)
    carried = under[(shown <= SUPPORT.shown) | (under[:, 2] < SUPPORT.on_table)]
    hull = convex_footprint_hull(carried).astype(np.float32)
    x, y, _ = placed.pose[0]
    return len(hull) > 2 and cv2.pointPolygonTest(hull, (x, y), measureDist=False) >= 0
