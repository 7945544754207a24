"""What stands for the segments of a photo, made to agree: pieces of known things are told, guessed boxes give way."""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.perception.proxies.box_clipping import EstimatedVolume, clip_boxes
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.registration.surface_inliers import asset_surface_at, surface_inliers
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.surfaces import Tree
from grs_agents.perception.table import robot_points_at
from grs_agents.perception.types import Mask, RGBDFrame, Solid, TableFrame, UprightBox

INSIDE = 0.5
"""What has more than this share of its points in the box of another, that is not hollow, is a piece of it."""
ENTANGLED = 0.1
"""So is what has more than this share of its own box there: boxes of two things can be clipped apart."""
SHAPED = 0.008
"""But for a thing whose points are farther off its box than this (m): one that leans does not fill its box."""
FILLED = 0.5
"""A guessed box of which a known thing fills more than this share is a piece of that."""
TOUCHING, TOUCHED = 0.012, 10
"""Pieces of one thing touch: at least so many points of one are nearer than this (m) to the other's."""


@dataclass(frozen=True)
class Segment:
    """A segment (H, W), what was measured of it, and the asset that stands for it with its pose, if it is known.

    Others may stand in what is ``hollow``.
    """

    mask: Mask
    box: UprightBox
    shape: Solid
    known: PlacedObject | None
    hollow: bool = False


@dataclass(frozen=True)
class Reconciled:
    """What became of segments, by their index.

    Attributes:
        pieces: which are pieces of which others, whose assets explain all their points, or whose boxes hold most.
        claims: the space that each of the others without an asset fills.
        masks: (H, W) the pixels of each of those, with those of its pieces.
        known: assets of the things of known shape that are no pieces, with their poses as in `Thing`.
        library: where their assets are looked up.
    """

    pieces: dict[int, int]
    claims: dict[int, EstimatedVolume]
    masks: dict[int, Mask]
    known: tuple[tuple[str, Pose], ...]
    library: Library

    def around(self, index: int) -> Surroundings:
        """What stands around the thing whose claim has that index."""
        others = [claim for number, claim in self.claims.items() if number != index]
        return Surroundings(self.known, others, self.library)


def reconcile_segments(
    segments: Sequence[Segment],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
    united: Mapping[int, int] | None = None,
) -> Reconciled:
    """Tell pieces of known things, and clip the boxes of what is not known by those and by each other.

    Args:
        segments: all of them.
        frame, table: the photo and its pose.
        library: where assets are looked up.
        united: pieces of others, by index, as `carriers` tells them.

    Raises:
        UnknownNameError: an asset is not in the library.
    """
    clouds = [robot_points_at(frame, table, *np.nonzero(one.mask & (frame.depth > 0))) for one in segments]
    shells = [
        None if one.known is None else asset_surface_at(one.known.asset, one.known.pose, library) for one in segments
    ]
    pieces = surface_inliers(clouds, shells)
    firm = [shell.points for index, shell in enumerate(shells) if shell is not None and index not in pieces]
    unknown = [index for index, shell in enumerate(shells) if shell is None and index not in pieces]
    solids = {index: Surroundings([(one.known.asset, one.known.pose)], (), library)
              for index, one in enumerate(segments) if one.known is not None and index not in pieces}  # fmt: skip
    known = Surroundings([one for solid in solids.values() for one in solid.known], (), library)
    claims = [
        EstimatedVolume(segments[index].box, segments[index].shape, clouds[index], segments[index].hollow).raised_onto(
            known.occupied
        )
        for index in unknown
    ]
    fitted = clip_boxes(claims, np.concatenate([np.zeros((0, 3)), *firm]))
    claimed = dict(zip(unknown, fitted, strict=True))
    for piece, claim in list(claimed.items()):
        filled = {index: float(solid.occupied(claim.grid_points).mean()) for index, solid in solids.items()}
        whole = max(filled, key=lambda index: filled[index], default=piece)
        if filled.get(whole, 0.0) > FILLED:
            pieces[piece] = whole
            del claimed[piece]
    masks = {index: segments[index].mask for index in claimed}
    for piece, whole in (united or {}).items():
        _join(piece, whole, claimed, masks, pieces)
    _unite(claimed, masks, pieces, segments)
    return Reconciled(pieces, claimed, {index: masks[index] for index in claimed}, tuple(known.known), library)


def supporting_segments(fell: AbstractSet[int], agreed: Reconciled) -> dict[int, int]:
    """Pieces of other things: what falls by itself is carried by what it touches, so they are one.

    Args:
        fell: things, by index, that fall in the twin.
        agreed: what became of them.
    """
    found: dict[int, int] = {}
    for piece in sorted(fell & agreed.claims.keys()):
        one = agreed.claims[piece]
        touching = {
            index: int((Tree(other.points).nearest(one.points)[1] < TOUCHING**2).sum())
            for index, other in agreed.claims.items()
            if index != piece and index not in found and not other.hollow
        }
        whole = max(touching, key=lambda index: touching[index], default=piece)
        if touching.get(whole, 0) >= TOUCHED:
            found[piece] = whole
    return found


def _unite(
    claims: dict[int, EstimatedVolume], masks: dict[int, Mask], pieces: dict[int, int], segments: Sequence[Segment]
) -> None:
    """Solid things are not inside each other: what still has most of its points in another's box belongs to it."""
    for piece in sorted(claims, key=lambda index: claims[index].volume):
        one = claims[piece]
        fits = one.mean_distance < SHAPED
        shares = {
            index: max(other.share_inside(one.points) / INSIDE, fits * other.share_inside(one.grid_points) / ENTANGLED)
            for index, other in claims.items()
            if index != piece and not segments[index].hollow and other.volume > one.volume
        }
        whole = max(shares, key=lambda index: shares[index], default=piece)
        if shares.get(whole, 0.0) > 1:
            _join(piece, whole, claims, masks, pieces)


def _join(
    piece: int, whole: int, claims: dict[int, EstimatedVolume], masks: dict[int, Mask], pieces: dict[int, int]
) -> None:
    """Make one thing of two."""
    claims[whole] = claims[whole].extended_by(claims[piece].points)
    masks[whole] = masks[whole] | masks[piece]
    pieces[piece] = whole
    del claims[piece]
