"""A quick guess of what strokes of the spatula do: pieces in its way end up ahead of it, one behind the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.arms.spatula import BLADE_THICKNESS, BLADE_WIDTH

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
_LANES: Final = 11
"""Strips of the blade's width in which pieces queue up behind one another."""


@dataclass(frozen=True)
class Pieces:
    """What may be pushed, seen from above.

    Attributes:
        ids: of the objects.
        places: (N, 2) their centres, metres.
        radii: (N,) half of their mean widths, metres.
    """

    ids: tuple[int, ...]
    places: FloatArray
    radii: FloatArray


@dataclass(frozen=True)
class Strokes:
    """Many strokes: the blade's front goes from ``starts`` to ``ends`` (S, 2), metres; no two points are the same."""

    starts: FloatArray
    ends: FloatArray

    @property
    def along(self) -> FloatArray:
        """Unit vectors (S, 2)."""
        step = self.ends - self.starts
        return step / np.linalg.norm(step, axis=1, keepdims=True)

    def only(self, chosen: BoolArray) -> "Strokes":
        """Those of them that are chosen (S,)."""
        return Strokes(self.starts[chosen], self.ends[chosen])


def _local(strokes: Strokes, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far ahead of the start and how far to the side (S, N) places (N, 2) are."""
    along = strokes.along
    offset = places[None] - strokes.starts[:, None]
    ahead = offset[..., 0] * along[:, :1] + offset[..., 1] * along[:, 1:]
    aside = offset[..., 1] * along[:, :1] - offset[..., 0] * along[:, 1:]
    return ahead, aside


def clear_starts(strokes: Strokes, pieces: Pieces, margin: float = 0.003) -> BoolArray:
    """Which strokes (S,) begin where the blade comes down on nothing."""
    ahead, aside = _local(strokes, pieces.places)
    reach = pieces.radii * 1.3 + margin
    under = (ahead > -BLADE_THICKNESS - reach) & (ahead < reach) & (np.abs(aside) < BLADE_WIDTH / 2 + reach)
    return np.logical_not(under.any(axis=1))


def predict(strokes: Strokes, pieces: Pieces) -> FloatArray:
    """Where the pieces (S, N, 2) would be after each stroke alone."""
    ahead, aside = _local(strokes, pieces.places)
    length = np.linalg.norm(strokes.ends - strokes.starts, axis=1)[:, None]
    half = BLADE_WIDTH / 2
    swept = (np.abs(aside) < half) & (ahead > 0)
    lane = np.clip(((aside + half) * (_LANES / BLADE_WIDTH)).astype(int), 0, _LANES - 1)
    width = BLADE_WIDTH / _LANES
    order = np.argsort(np.where(swept, ahead, np.inf), axis=1)
    front = np.repeat(length, _LANES, axis=1)  # how far each lane is taken up, from the start
    moved = ahead.copy()
    rows, radii = np.arange(len(ahead)), pieces.radii
    for rank in range(int(swept.sum(axis=1).max(initial=0))):
        piece = order[:, rank]
        active = swept[rows, piece]
        strip = lane[rows, piece]
        here = np.maximum(ahead[rows, piece], front[rows, strip] + radii[piece])
        moved[rows[active], piece[active]] = here[active]
        depth = np.minimum(4 * radii[piece] ** 2 / width, 2 * radii[piece])
        full = np.maximum(front[rows, strip], here - radii[piece] + depth)
        pushed = active & (here > ahead[rows, piece])
        front[rows[pushed], strip[pushed]] = full[pushed]
    return pieces.places[None] + (moved - ahead)[..., None] * strokes.along[:, None]


def joined(parts: Sequence[Strokes]) -> Strokes:
    """Several sets of strokes as one."""
    return Strokes(np.vstack([part.starts for part in parts]), np.vstack([part.ends for part in parts]))
