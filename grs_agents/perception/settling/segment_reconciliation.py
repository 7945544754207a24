"""What stands for the segments of a photo, made to agree: pieces join known objects, guessed boxes are clipped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import Surface, asset_surface_at_pose
from grs_agents.perception.image_geometry import pixels_in_mask
from grs_agents.perception.proxies.box_clipping import EstimatedVolume, clip_boxes
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.registration.unexplained_segments import match_pieces_to_objects
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, Solid, TableFrame, UprightBox


@dataclass(frozen=True)
class Segment:
    """A segment (H, W), its measured box, and its asset, if that is known; others may stand in what is hollow.
    A ``given`` one is an object, and no piece of another."""

    mask: Mask
    box: UprightBox
    shape: Solid
    known: PlacedObject | None
    hollow: bool = False
    given: bool = False

    def posed_asset_surface(self, library: Library) -> Surface | None:
        """The surface of its asset."""
        return None if self.known is None else asset_surface_at_pose(self.known.asset, self.known.pose, library)


@dataclass(frozen=True)
class Reconciled:
    """What became of segments, by their index."""

    pieces: dict[int, int]  # which are pieces of which others, whose assets explain their points
    claims: dict[int, EstimatedVolume]  # the space that each of the others without an asset fills


def reconcile_segments(
    segments: Sequence[Segment], frame: RGBDFrame, table: TableFrame, library: Library
) -> Reconciled:
    """Find the pieces of known objects, and clip the boxes of what is not known by those and by each other."""
    clouds = [pixels_to_robot_frame(frame, table, *pixels_in_mask(one.mask & (frame.depth > 0))) for one in segments]
    surfaces = [segment.posed_asset_surface(library) for segment in segments]
    found = match_pieces_to_objects(clouds, surfaces)
    pieces = {piece: whole for piece, whole in found.items() if not segments[piece].given}
    known = {index: one.known for index, one in enumerate(segments) if one.known is not None and index not in pieces}
    around = Surroundings([(one.asset, one.pose) for one in known.values()], library)
    boxes = _estimate_unknown_volumes(segments, clouds, pieces, around)
    obstacles = [surface.points for index in known if (surface := surfaces[index]) is not None]
    clipped = clip_boxes(list(boxes.values()), np.concatenate([np.zeros((0, 3)), *obstacles]))
    return Reconciled(pieces, dict(zip(boxes, clipped, strict=True)))


def _estimate_unknown_volumes(
    segments: Sequence[Segment], clouds: Sequence[Array], pieces: Mapping[int, int], around: Surroundings
) -> dict[int, EstimatedVolume]:
    """The space that each segment fills that has no asset and is no piece."""
    unknown = {index: one for index, one in enumerate(segments) if one.known is None and index not in pieces}
    boxes = {index: EstimatedVolume(one.box, one.shape, clouds[index], one.hollow) for index, one in unknown.items()}
    return {index: box.lift_bottom_above_occupied(around.occupied_points_mask) for index, box in boxes.items()}
