"""Reconcile the segments of a photo: pieces join the assets that explain them, estimated volumes are clipped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.asset_surfaces import asset_surface_at_pose
from grs_agents.perception.image_geometry import pixels_in_mask
from grs_agents.perception.proxies.box_clipping import EstimatedVolume, clip_boxes
from grs_agents.perception.proxies.meshes import inside_colliders_mask
from grs_agents.perception.registration.unexplained_segments import match_pieces_to_objects
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Array, CandidateRecord, Mask, RGBDFrame, TableFrame


@dataclass(frozen=True)
class Reconciled:
    """The outcome for each segment, by index."""

    pieces: dict[int, int]  # pieces, each with the object whose asset explains its points
    claims: dict[int, EstimatedVolume]  # the volume of each other segment without an asset


def reconcile_segments(
    records: Sequence[CandidateRecord],
    masks: Sequence[Mask],
    known: Sequence[PlacedObject | None],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
) -> Reconciled:
    """Find the pieces of known objects; clip the boxes of unknown objects by known objects and by each other.

    Args:
        records: the measured segments; a ``given`` one is no piece of another.
        masks: (H, W) of each segment.
        known: the asset of each segment at its pose; None if it has no asset.
        frame: the photo.
        table: the table in it.
        library: the library that holds the assets.
    """
    clouds = [pixels_to_robot_frame(frame, table, *pixels_in_mask(mask & (frame.depth > 0))) for mask in masks]
    surfaces = [None if asset is None else asset_surface_at_pose(asset.asset, asset.pose, library) for asset in known]
    found = match_pieces_to_objects(clouds, surfaces)
    pieces = {piece: whole for piece, whole in found.items() if not records[piece].given}
    kept = [index for index in range(len(records)) if index not in pieces]
    around = [asset for index in kept if (asset := known[index]) is not None]
    obstacles = [surface.points for index in kept if (surface := surfaces[index]) is not None]

    def occupied(points: Array) -> Mask:
        return occupied_points_mask(points, around, library)

    volumes = {
        index: EstimatedVolume(record.upright, record.shape, clouds[index], record.hollow).lift_bottom_above_occupied(
            occupied
        )
        for index, record in enumerate(records)
        if known[index] is None and index not in pieces
    }
    clipped = clip_boxes(list(volumes.values()), np.concatenate([np.zeros((0, 3)), *obstacles]))
    return Reconciled(pieces, dict(zip(volumes, clipped, strict=True)))


def occupied_points_mask(points: Array, around: Sequence[PlacedObject], library: Library) -> Mask:
    """Mask (N,) of the points (N, 3), m, robot frame, inside the colliders of known objects."""
    occupied = np.zeros(len(points), np.bool_)
    for thing in around:
        position, orientation = thing.pose
        model = library.load_object_model(thing.asset)
        low, high = np.array(model.bounds)
        near = np.flatnonzero(np.linalg.norm(points - position, axis=1) < np.linalg.norm(high - low) / 2)
        if len(near):
            local = (points[near] - position) @ matrix_from_quaternion(orientation) + (low + high) / 2
            occupied[near] |= inside_colliders_mask(model, library, local)
    return occupied
