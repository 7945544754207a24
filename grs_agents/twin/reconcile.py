"""What stands for the segments of a photo, made to agree: pieces of known things are told, guessed boxes give way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.library import Library
from grs_agents.scene import Claim, Mask, RGBDFrame, TableFrame, clipped, explained, shell_of
from grs_agents.scene.table import robot_points_at
from grs_agents.scene.types import Solid, UprightBox
from grs_agents.twin.thing import Thing

INSIDE = 0.5
"""What has more than this share of its points in the box of another, that is not hollow, is a piece of it."""


@dataclass(frozen=True)
class Segment:
    """A segment (H, W), what was measured of it, and the asset that stands for it with its pose, if it is known.

    Others may stand in what is ``hollow``.
    """

    mask: Mask
    box: UprightBox
    shape: Solid
    known: Thing | None
    hollow: bool = False


@dataclass(frozen=True)
class Reconciled:
    """What became of segments, by their index.

    Attributes:
        pieces: which are pieces of which others, whose assets explain all their points, or whose boxes hold most.
        claims: the space that each of the others without an asset fills.
    """

    pieces: dict[int, int]
    claims: dict[int, Claim]


def reconcile(segments: Sequence[Segment], frame: RGBDFrame, table: TableFrame, library: Library) -> Reconciled:
    """Tell pieces of known things, and clip the boxes of what is not known by those and by each other.

    Raises:
        UnknownNameError: an asset is not in the library.
    """
    clouds = [robot_points_at(frame, table, *np.nonzero(one.mask & (frame.depth > 0))) for one in segments]
    shells = [None if one.known is None else shell_of(one.known.asset, one.known.pose, library) for one in segments]
    pieces = explained(clouds, shells)
    firm = [shell.points for index, shell in enumerate(shells) if shell is not None and index not in pieces]
    unknown = [index for index, shell in enumerate(shells) if shell is None and index not in pieces]
    claims = [Claim(segments[index].box, segments[index].shape, clouds[index]) for index in unknown]
    fitted = clipped(claims, np.concatenate([np.zeros((0, 3)), *firm]))
    return _united(dict(zip(unknown, fitted, strict=True)), pieces, segments)


def _united(claims: dict[int, Claim], pieces: dict[int, int], segments: Sequence[Segment]) -> Reconciled:
    """Solid things are not inside each other: what still has most of its points in another's box belongs to it."""
    for piece in sorted(claims, key=lambda index: claims[index].volume):
        one = claims[piece]
        shares = {
            index: other.share(one.points)
            for index, other in claims.items()
            if index != piece and not segments[index].hollow and other.volume > one.volume
        }
        whole = max(shares, key=lambda index: shares[index], default=piece)
        if shares.get(whole, 0.0) > INSIDE:
            claims[whole] = claims[whole].joined(one.points)
            pieces[piece] = whole
            del claims[piece]
    return Reconciled(pieces, claims)
