"""What stands for the segments of a photo, made to agree: pieces join known objects, guessed boxes are clipped."""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.perception.asset_surfaces import Surface, Tree, asset_surface_at_pose
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.proxies import EstimatedVolume, Surroundings, clip_boxes
from grs_agents.perception.registration import match_pieces_to_objects
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import Array, Mask, RGBDFrame, Solid, TableFrame, UprightBox

CONFIG = DEFAULT.settling.reconciliation


@dataclass(frozen=True)
class Segment:
    """A segment (H, W), its measured box, and its asset, if that is known; others may stand in what is hollow."""

    mask: Mask
    box: UprightBox
    shape: Solid
    known: PlacedObject | None
    hollow: bool = False

    def posed_asset_surface(self, library: Library) -> Surface | None:
        """The surface of its asset."""
        return None if self.known is None else asset_surface_at_pose(self.known.asset, self.known.pose, library)


@dataclass(frozen=True)
class Reconciled:
    """What became of segments, by their index."""

    # which are pieces of which others, whose assets explain all their points, or whose boxes hold most
    pieces: dict[int, int]
    claims: dict[int, EstimatedVolume]  # the space that each of the others without an asset fills
    masks: dict[int, Mask]  # (H, W) the pixels of each of those, with those of its pieces
    # assets of the objects of known shape that are no pieces, with their poses as in `PlacedObject`
    known: tuple[tuple[str, Pose], ...]
    library: Library  # where their assets are looked up

    def surroundings_of_segment(self, index: int) -> Surroundings:
        """What stands around the object whose claim has that index."""
        others = [claim for number, claim in self.claims.items() if number != index]
        return Surroundings(self.known, others, self.library)


def reconcile_segments(
    segments: Sequence[Segment],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
    united: Mapping[int, int] | None = None,
) -> Reconciled:
    """Find the pieces of known objects, and clip the boxes of what is not known by those and by each other.
    ``united`` are pieces of others, by index, as `match_fallen_to_support` finds them."""
    clouds = [pixels_to_robot_frame(frame, table, *np.nonzero(one.mask & (frame.depth > 0))) for one in segments]
    surfaces = [segment.posed_asset_surface(library) for segment in segments]
    pieces = match_pieces_to_objects(clouds, surfaces)
    solids = _known_spaces(segments, pieces, library)
    around = Surroundings([asset for solid in solids.values() for asset in solid.known], (), library)
    boxes = _estimate_unknown_volumes(segments, clouds, pieces, around)
    obstacles = [surface.points for index in solids if (surface := surfaces[index]) is not None]
    clipped = clip_boxes(list(boxes.values()), np.concatenate([np.zeros((0, 3)), *obstacles]))
    claimed = dict(zip(boxes, clipped, strict=True))
    _assign_boxes_filled_by_asset(claimed, pieces, solids)
    masks = {index: segments[index].mask for index in claimed}
    for piece, other in (united or {}).items():
        _join_piece_to_whole(piece, other, claimed, masks, pieces)
    _join_contained_objects(claimed, masks, pieces, segments)
    return Reconciled(pieces, claimed, {index: masks[index] for index in claimed}, tuple(around.known), library)


def _known_spaces(segments: Sequence[Segment], pieces: Mapping[int, int], library: Library) -> dict[int, Surroundings]:
    """The space that each known object fills that is no piece."""
    known = {index: one.known for index, one in enumerate(segments) if one.known is not None and index not in pieces}
    return {index: Surroundings([(one.asset, one.pose)], (), library) for index, one in known.items()}


def _estimate_unknown_volumes(
    segments: Sequence[Segment], clouds: Sequence[Array], pieces: Mapping[int, int], around: Surroundings
) -> dict[int, EstimatedVolume]:
    """The space that each segment fills that has no asset and is no piece."""
    unknown = {index: one for index, one in enumerate(segments) if one.known is None and index not in pieces}
    boxes = {index: EstimatedVolume(one.box, one.shape, clouds[index], one.hollow) for index, one in unknown.items()}
    return {index: box.raise_above_occupied_space(around.occupied_points_mask) for index, box in boxes.items()}


def _assign_boxes_filled_by_asset(
    claims: dict[int, EstimatedVolume], pieces: dict[int, int], solids: Mapping[int, Surroundings]
) -> None:
    """Make pieces of known objects of those boxes that one of them mostly fills."""
    for piece, claim in list(claims.items()):
        filled = {index: float(solid.occupied_points_mask(claim.grid_points).mean()) for index, solid in solids.items()}
        whole = max(filled, key=lambda index: filled[index], default=piece)
        if filled.get(whole, 0.0) > CONFIG.filled:
            pieces[piece] = whole
            del claims[piece]


def match_fallen_to_support(fell: AbstractSet[int], agreed: Reconciled) -> dict[int, int]:
    """Which objects are pieces of others: what falls by itself in the twin is carried by what it touches."""
    found: dict[int, int] = {}
    for piece in sorted(fell & agreed.claims.keys()):
        one = agreed.claims[piece]
        touching = {
            index: int((Tree(other.points).find_nearest_points(one.points)[1] < CONFIG.touching**2).sum())
            for index, other in agreed.claims.items()
            if index != piece and index not in found and not other.hollow
        }
        whole = max(touching, key=lambda index: touching[index], default=piece)
        if touching.get(whole, 0) >= CONFIG.touched:
            found[piece] = whole
    return found


def _join_contained_objects(
    claims: dict[int, EstimatedVolume], masks: dict[int, Mask], pieces: dict[int, int], segments: Sequence[Segment]
) -> None:
    """Solid objects are not inside each other: what still has most of its points in another's box belongs to it."""
    for piece in sorted(claims, key=lambda index: claims[index].box_volume):
        one = claims[piece]
        fits = one.mean_surface_distance < CONFIG.misshapen
        shares = {
            index: max(
                other.fraction_of_points_inside(one.points) / CONFIG.inside,
                fits * other.fraction_of_points_inside(one.grid_points) / CONFIG.overlapping,
            )
            for index, other in claims.items()
            if index != piece and not segments[index].hollow and other.box_volume > one.box_volume
        }
        whole = max(shares, key=lambda index: shares[index], default=piece)
        if shares.get(whole, 0.0) > 1:
            _join_piece_to_whole(piece, whole, claims, masks, pieces)


def _join_piece_to_whole(
    piece: int, whole: int, claims: dict[int, EstimatedVolume], masks: dict[int, Mask], pieces: dict[int, int]
) -> None:
    """Make one object of two."""
    claims[whole] = claims[whole].extend_by_points(claims[piece].points)
    masks[whole] = masks[whole] | masks[piece]
    pieces[piece] = whole
    del claims[piece]
