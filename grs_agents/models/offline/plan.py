"""A plan: objects and their places, independent of the scene, from which a program is written.

Places come from rows inside a rectangle and from free places on the table; objects do not touch.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.models.offline.prompt_text import FAR, GAP, NEAR, PromptObject, Rect, Vector

CONTAINER = "container/container-template.urdf"
ZONE = "zone/zone-template.urdf"
WALL = 0.005
"""Thickness of a container template's walls and floor, metres."""
ZONE_HEIGHT = 0.002

Family = Literal["pack", "stack", "sort", "line", "place", "match", "clear", "exchange"]


@dataclass(frozen=True)
class Target:
    """A place on the table that goals refer to."""

    name: str  # a Python identifier, e.g. `red_zone`
    # `container` (a filled template), `zone` (a flat mark), `free` (bare table) or `object` (an object of the scene at
    # its place)
    kind: Literal["container", "zone", "free", "object"]
    size: Vector  # extents in metres
    place: tuple[float, float]  # (x, y) of a place known to be free
    color: str = ""  # its colour's name
    moves: bool = True  # each seed draws a place for it
    obj: PromptObject | None = None  # the object, for kind `object`
    # the free centres (N, 2) of its size, on the grid, when it was laid out
    free: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)), compare=False, repr=False)

    @property
    def footprint_rect(self) -> Rect:
        """Footprint, as far as it is known before the program runs."""
        return Rect(*self.place, *self.size[:2])

    @property
    def label(self) -> str:
        """Everyday name."""
        return self.obj.label if self.obj else self.name.replace("_", " ")

    @property
    def asset_name(self) -> str:
        """Library name of the asset that marks it; empty for bare table."""
        if self.obj:
            return self.obj.asset
        return {"container": CONTAINER, "zone": ZONE}.get(self.kind, "")


@dataclass(frozen=True)
class Move:
    """A pick-and-place."""

    obj: PromptObject  # object to move
    target: Target  # its destination
    offset: Vector  # the object's centre from the frame's place at table height, metres


@dataclass(frozen=True)
class PlacementPlan:
    """A whole task."""

    family: Family  # the kind of task
    targets: tuple[Target, ...]  # the places, in the order in which they are laid out
    moves: tuple[Move, ...]  # in order
    criterion: str = ""  # property that separates or orders objects, e.g. `color`
    exact: bool = False  # each object must end at its exact spot, not just inside its frame

    @property
    def moved_objects(self) -> tuple[PromptObject, ...]:
        """The objects that are moved, each once, in the order of the moves."""
        return tuple(dict.fromkeys(move.obj for move in self.moves))

    @property
    def asset_names(self) -> tuple[str, ...]:
        """Every asset that the program uses, each once."""
        names = [obj.asset for obj in self.moved_objects] + [target.asset_name for target in self.targets]
        return tuple(dict.fromkeys(name for name in names if name))


X_RANGE, Y_RANGE = (0.25, 0.75), (-0.5, 0.5)
"""The part of the table that random poses are drawn from, metres, robot frame."""
STEP = 0.02
"""Spacing of the grid of candidate places, m."""
_LEAST_PLACES = 10
"""Fewer free places than these, 40 cm2 of centres, are not found by drawing at random."""


MAX_ZONE_HEIGHT = 0.25
"""Height (m) of the workspace's ceiling; zones score only below it."""


@dataclass(frozen=True)
class RowLayout:
    """Rectangles laid side by side in rows."""

    # centre of each rectangle from the centre of the whole, in the order given
    offsets: tuple[tuple[float, float], ...]
    width: float  # extent of the whole along x
    depth: float  # extent of the whole along y


def list_row_arrangements(footprints: Sequence[tuple[float, float]], gap: float) -> list[RowLayout]:
    """Arrange ``footprints`` (x, y extents) in a row, two rows and so on; the most compact arrangement first."""
    options = [arrange_in_rows(footprints, count, gap) for count in range(1, len(footprints) + 1)]
    return sorted(options, key=lambda option: math.hypot(option.width, option.depth))


def arrange_in_rows(footprints: Sequence[tuple[float, float]], rows: int, gap: float) -> RowLayout:
    """Arrange ``footprints`` (x, y extents) in ``rows`` rows along y."""
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
    return RowLayout(tuple(offsets), whole, max(depths))


@dataclass
class Table:
    """Occupied areas of the table while a plan is made."""

    taken: list[Rect] = field(default_factory=list[Rect])
    far: float = FAR  # greatest comfortable radius from the robot's base, metres

    def reserve_free_place(self, width: float, depth: float) -> tuple[float, float] | None:
        """Reserve the free place (its centre) for a rectangle that is easiest to reach; None if there is none."""
        for x, y in self.find_free_places(width, depth)[:1].tolist():
            self.taken.append(Rect(x, y, width, depth))
            return x, y
        return None

    def find_free_places(self, width: float, depth: float) -> npt.NDArray[np.float64]:
        """The free centres (N, 2) of a rectangle, the easiest to reach first."""
        rows = list(_iterate_grid_coordinates(Y_RANGE[0] + depth / 2, Y_RANGE[1] - depth / 2))
        columns = list(_iterate_grid_coordinates(X_RANGE[0] + width / 2, X_RANGE[1] - width / 2))
        x, y = (axis.ravel() for axis in np.meshgrid(np.array(columns), np.array(rows), indexing="ij"))
        low = np.hypot(np.maximum(0, abs(x) - width / 2), np.maximum(0, abs(y) - depth / 2))
        free = (low >= NEAR - 0.05) & (np.hypot(abs(x) + width / 2, abs(y) + depth / 2) <= self.far + 0.03)
        for rect in self.taken:
            aside = abs(x - rect.x) >= (width + rect.width) / 2 + GAP
            free &= aside | (abs(y - rect.y) >= (depth + rect.depth) / 2 + GAP)
        effort = abs(np.hypot(x, y)[free] - 0.52)
        return np.stack([x[free], y[free]], axis=1)[np.argsort(effort, kind="stable")]


def may_leave_no_place(drawn: Sequence[Target]) -> bool:
    """True if a random place of a target may leave hardly any free place to a second target."""
    for target, rival in permutations(drawn, 2):
        distances = abs(target.free[:, None] - rival.free)  # for each pair of places, along x and y
        clear = (distances >= (np.add(target.size[:2], rival.size[:2])) / 2 + GAP).any(axis=2)
        if int(clear.sum(axis=1).min(initial=len(rival.free))) < _LEAST_PLACES:
            return True
    return False


def _iterate_grid_coordinates(low: float, high: float) -> Iterable[float]:
    count = math.floor((high - low) / STEP + 1e-9) + 1
    return (round(low + STEP * index, 4) for index in range(max(0, count)))


def select_objects_without_overlap(
    objects: Iterable[PromptObject], limit: int, gap: float = 0.004
) -> list[PromptObject]:
    """The first objects, at most ``limit``, of which no two overlap."""
    chosen: list[PromptObject] = []
    for obj in objects:
        if len(chosen) < limit and not any(
            obj.footprint_rect.overlaps(earlier.footprint_rect, gap) for earlier in chosen
        ):
            chosen.append(obj)
    return chosen


def is_pickable_object(obj: PromptObject) -> bool:
    """True if the suction cup can lift it from above and set it down upright."""
    footprint = min(obj.size[:2])
    small_enough = max(obj.size[:2]) <= 0.32 and obj.size[2] <= MAX_ZONE_HEIGHT
    return not obj.hollow and footprint >= 0.018 and obj.size[2] >= 0.008 and small_enough


def is_hard_to_topple(obj: PromptObject) -> bool:
    """True if its height is at most four times its least width."""
    return obj.size[2] <= 4.0 * min(obj.size[:2])


def is_reachable_object(obj: PromptObject) -> bool:
    """True if the arm can pick it at its place: within reach, free, and picked in a trial."""
    radius = math.hypot(obj.position[0], obj.position[1])
    return (
        obj.reachable and obj.can_be_picked and not obj.floats and NEAR <= radius <= obj.far and obj.position[0] > 0.1
    )
