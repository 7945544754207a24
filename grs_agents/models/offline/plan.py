"""A plan: which things move where; a program is written from it, and it says nothing of any one scene."""

from dataclasses import dataclass
from typing import Literal

from grs_agents.models.offline.scene_objects import Thing, Vector

CONTAINER = "container/container-template.urdf"
ZONE = "zone/zone-template.urdf"
WALL = 0.005
"""Thickness of a container template's walls and floor, metres."""
ZONE_HEIGHT = 0.002

Family = Literal["pack", "stack", "sort", "line", "place", "match", "clear"]


@dataclass(frozen=True)
class Frame:
    """A place on the table that goals refer to.

    Attributes:
        name: a Python identifier, e.g. ``red_zone``.
        kind: ``container`` (a filled template), ``zone`` (a flat mark), ``free`` (bare table) or ``thing`` (an
            object of the scene that serves where it stands).
        size: extents in metres.
        place: (x, y) of a place known to be free.
        color: its colour's name.
        moves: whether each seed draws another place for it.
        thing: the object, for kind ``thing``.
    """

    name: str
    kind: Literal["container", "zone", "free", "thing"]
    size: Vector
    place: tuple[float, float]
    color: str = ""
    moves: bool = True
    thing: Thing | None = None

    @property
    def label(self) -> str:
        """What people call it."""
        return self.thing.label if self.thing else self.name.replace("_", " ")

    @property
    def asset(self) -> str:
        """The library name of what marks it; empty for bare table."""
        if self.thing:
            return self.thing.asset
        return {"container": CONTAINER, "zone": ZONE}.get(self.kind, "")


@dataclass(frozen=True)
class Move:
    """One pick-and-place.

    Attributes:
        thing: what is moved.
        frame: where to.
        offset: the object's centre from the frame's place at table height, metres.
    """

    thing: Thing
    frame: Frame
    offset: Vector


@dataclass(frozen=True)
class Plan:
    """A whole task.

    Attributes:
        family: the kind of task.
        frames: the places, in the order in which they are laid out.
        moves: what the robot does, in order.
        note: how things are told apart or ordered, e.g. ``color``.
        exact: whether each object must stand at its very spot, rather than anywhere inside its frame.
    """

    family: Family
    frames: tuple[Frame, ...]
    moves: tuple[Move, ...]
    note: str = ""
    exact: bool = False

    @property
    def things(self) -> tuple[Thing, ...]:
        """The objects that are moved, each once, in the order of the moves."""
        return tuple(dict.fromkeys(move.thing for move in self.moves))

    @property
    def assets(self) -> tuple[str, ...]:
        """Every asset that the program uses, each once."""
        names = [thing.asset for thing in self.things] + [frame.asset for frame in self.frames]
        return tuple(dict.fromkeys(name for name in names if name))
