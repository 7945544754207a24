"""Where things fit: rows inside a rectangle, free places on the table, objects that do not touch."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from grs_agents.models.offline.scene_objects import FAR, GAP, NEAR, Rect, Thing

X_RANGE, Y_RANGE = (0.25, 0.75), (-0.5, 0.5)
"""The part of the table that random poses are drawn from, metres, robot frame."""
STEP = 0.02
"""The grid on which free places are looked for, metres."""


TALLEST = 0.25
"""Zones score only what lies below the workspace's ceiling, metres."""


@dataclass(frozen=True)
class Rows:
    """Rectangles laid side by side in rows.

    Attributes:
        offsets: centre of each rectangle from the centre of the whole, in the order given.
        width: extent of the whole along x.
        depth: extent of the whole along y.
    """

    offsets: tuple[tuple[float, float], ...]
    width: float
    depth: float


def in_rows(footprints: Sequence[tuple[float, float]], rows: int = 0, gap: float = GAP) -> Rows:
    """Lay ``footprints`` (x, y extents) out in so many rows along y; 0 rows: as many as make the whole compact."""
    if rows:
        return _rows(footprints, rows, gap)
    options = [_rows(footprints, count, gap) for count in range(1, len(footprints) + 1)]
    return min(options, key=lambda option: math.hypot(option.width, option.depth))


def _rows(footprints: Sequence[tuple[float, float]], rows: int, gap: float) -> Rows:
    length = math.ceil(len(footprints) / rows)
    groups = [footprints[start : start + length] for start in range(0, len(footprints), length)]
    widths = [max(width for width, _ in group) for group in groups]
    depths = [sum(depth for _, depth in group) + gap * (len(group) - 1) for group in groups]
    whole = sum(widths) + gap * (len(groups) - 1)
    offsets: list[tuple[float, float]] = []
    x = -whole / 2
    for group, width, depth in zip(groups, widths, depths, strict=True):
        y = -depth / 2
        for _, extent in group:
            offsets.append((x + width / 2, y + extent / 2))
            y += extent + gap
        x += width + gap
    return Rows(tuple(offsets), whole, max(depths))


@dataclass
class Table:
    """What is taken on the table while a plan is made."""

    taken: list[Rect] = field(default_factory=list[Rect])

    def place(self, width: float, depth: float) -> tuple[float, float] | None:
        """The free centre for a rectangle that is easiest to reach, then taken; None where there is none."""
        best: tuple[float, tuple[float, float]] | None = None
        for x in _steps(X_RANGE[0] + width / 2, X_RANGE[1] - width / 2):
            for y in _steps(Y_RANGE[0] + depth / 2, Y_RANGE[1] - depth / 2):
                rect = Rect(x, y, width, depth)
                low, high = rect.radii()
                if low < NEAR - 0.05 or high > FAR + 0.03 or any(rect.overlaps(other, GAP) for other in self.taken):
                    continue
                effort = abs(math.hypot(x, y) - 0.52)
                if best is None or effort < best[0]:
                    best = effort, (x, y)
        if best is None:
            return None
        self.taken.append(Rect(*best[1], width, depth))
        return best[1]


def _steps(low: float, high: float) -> Iterable[float]:
    count = math.floor((high - low) / STEP + 1e-9) + 1
    return (round(low + STEP * index, 4) for index in range(max(0, count)))


def apart(things: Iterable[Thing], limit: int, gap: float = 0.004) -> list[Thing]:
    """The first things, at most ``limit``, of which no two overlap."""
    chosen: list[Thing] = []
    for thing in things:
        if len(chosen) < limit and not any(thing.rect.overlaps(other.rect, gap) for other in chosen):
            chosen.append(thing)
    return chosen


def pickable(thing: Thing) -> bool:
    """Whether the suction cup can lift it from above and set it down upright."""
    footprint = min(thing.size[:2])
    small_enough = max(thing.size[:2]) <= 0.32 and thing.size[2] <= TALLEST
    return not thing.hollow and footprint >= 0.018 and thing.size[2] >= 0.008 and small_enough


def steady(thing: Thing) -> bool:
    """Whether it stands without toppling at a touch."""
    return thing.size[2] <= 4.0 * min(thing.size[:2])


def in_reach(thing: Thing) -> bool:
    """Whether the arm can pick it where it stands."""
    radius = math.hypot(thing.position[0], thing.position[1])
    return thing.reachable and NEAR <= radius <= FAR and thing.position[0] > 0.1
