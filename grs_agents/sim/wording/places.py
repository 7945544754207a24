"""Phrases for the places that goals ask for: supports, neighbours, distances and turns."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.wording.noun_phrases import NounPhrases
from grs_agents.sim.wording.table_state import SEEN, TURNED, TableState
from grs_agents.sim.world.footprints import distance_between_outlines, margins_inside_outline

_SAME_PLACE: Final = 0.02
"""Horizontal distance (m) within which two centres are at the same place."""
_NEIGHBOR: Final = 0.06
"""Largest gap (m) to an object that a place on the bare table is described by."""
_STRAIGHT: Final = 0.02
"""Largest offset (m) across the direction to that object."""
_ROOM: Final = 0.03
"""Free room (m) on a support from which on the spot on it is stated."""
_ROUND, _SQUARE = 1.1, 1.48
"""Largest ratio of the outer to the inner radius of an outline that counts as round (a polygon of 12 corners has 1.04),
and as a square (1.41)."""
_POINT: Final = np.zeros((1, 2))


@dataclass(frozen=True)
class Place:
    """A place that a goal asks for."""

    text: str  # ``in the open box``, ``12 cm to the left``; empty for the object's own place
    references: tuple[int, ...] = ()  # ids of the objects in the text
    free: bool = False  # a spot on the bare table, by its distance from the object's start
    spot: tuple[float, float] | None = None  # x and y (m) of a pose


@dataclass(frozen=True)
class PlacePhrases:
    """Descriptions of targets and zones on a table."""

    table: TableState
    nouns: NounPhrases

    def describe_zone(self, zone: Zone, number: int) -> Place:
        """Describe a zone by the smallest object that contains it, else by its size and middle."""
        for how, container in self.table.find_zone_support(zone, number):
            return Place(f"{how} {self.nouns.name(container)}", (container,))
        x, y, _ = zone.pose[0]
        width, depth = (f"{100 * extent:.0f}" for extent in zone.size[:2])
        aside = f" and {_centimetres(abs(y))} to its {'left' if y > 0 else 'right'}" if abs(y) >= SEEN else ""
        middle = f"whose middle is {_centimetres(x)} in front of the robot{aside}"
        return Place(f"within the unmarked area of {width} by {depth} cm {middle}")

    def describe_target(self, target: Pose, number: int, only: bool) -> Place:
        """Describe a pose by its support, by the object that stood there, by a neighbour, or by its distance.

        Args:
            target: the pose (m, robot frame).
            number: id of the object.
            only: False for one of several targets, whose spots on a support need not be told apart.
        """
        x, y, _ = target[0]
        supports = self.table.find_supports(self.table.prism(number, self._settle(target, number)), self.table.end)
        left = [
            neighbor
            for neighbor, pose in self.table.initial.items()
            if neighbor != number
            and neighbor in self.table.displaced
            and math.dist(pose[0][:2], (x, y)) < _SAME_PLACE
            and math.dist(pose[0][:2], self.table.final[neighbor][0][:2]) > _SAME_PLACE
        ]
        carried = any(how == "on" and support not in self.table.hollow | self.table.marks for how, support in supports)
        if left and not carried:  # else a newcomer at that place carries the object
            return Place(f"where {self.nouns.name(left[0])} stood")
        if supports:
            texts = [self._describe_support(target, number, how, support, only) for how, support in supports]
            return Place(" and ".join(texts), tuple(support for _, support in supports), spot=(x, y))
        return self._describe_free_spot((x, y), number)

    def describe_turn(self, goal: Goal, row: int) -> str:
        """The turn about the vertical that a pose goal asks for: ``by 43 degrees counterclockwise``; empty if none is
        seen: any of what is round, a quarter of a block's."""
        number, allowed = goal.objects[row], goal.allowed_target_indices(row)
        symmetry = goal.symmetries[row]
        if not (goal.rotations and symmetry > 0 and len(allowed) == 1):
            return ""
        outline = self.table.start[number].outline
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2  # the mean leans to where corners are dense
        inner = float(margins_inside_outline(_POINT, outline, middle[None])[0])
        outer = float(np.linalg.norm(outline - middle, axis=1).max())
        if outer < _ROUND * inner:
            return ""
        if outer < _SQUARE * inner and self.table.names[number].endswith(("block", "cube")):
            symmetry = min(symmetry, math.pi / 2)
        start = transforms.yaw_of_quaternion(self.table.initial[number][1])
        turn = (transforms.yaw_of_quaternion(goal.targets[allowed[0]][1]) - start) % symmetry
        degrees = round(math.degrees(turn - symmetry if turn > symmetry / 2 else turn))
        if abs(degrees) <= TURNED:
            return ""
        return f"by {abs(degrees)} degrees {'counterclockwise' if degrees > 0 else 'clockwise'}"

    def _settle(self, target: Pose, number: int) -> Pose:
        """The target at the measured height, if the object ends there: targets are often a little too high."""
        end = self.table.final.get(number)
        if end is None or math.dist(end[0][:2], target[0][:2]) > _SAME_PLACE:
            return target
        return (target[0][0], target[0][1], end[0][2]), target[1]

    def _describe_support(self, target: Pose, number: int, how: str, support: int, spot: bool) -> str:
        """``in the box``; with ``spot`` and room for it ``on the left part of the zone``."""
        name = self.nouns.name(support)
        if not spot or support not in self.table.hollow | self.table.marks:
            return f"{how} {name}"
        around, prism = self.table.end[support].bounding_box_xy, self.table.prism(number, target).bounding_box_xy
        room = [(around[axis + 2] - around[axis] - prism[axis + 2] + prism[axis]) / 2 for axis in (0, 1)]
        if max(room) < _ROOM:
            return f"{how} {name}"
        along, aside = (target[0][axis] - (around[axis] + around[axis + 2]) / 2 for axis in (0, 1))
        words = [("far", "near")[along < 0]] if abs(along) >= _SAME_PLACE else []
        words += [("left", "right")[aside < 0]] if abs(aside) >= _SAME_PLACE else []
        return f"{how} the {' '.join(words)} part of {name}" if words else f"in the middle of {name}"

    def _describe_free_spot(self, spot: tuple[float, float], number: int) -> Place:
        start = self.table.initial[number][0]
        if math.dist(start[:2], spot) < _SAME_PLACE:
            return Place("")
        movers = {mover for goal in self.table.instance.goals for mover in goal.objects}
        prism = self.table.prism(number, ((*spot, start[2]), self.table.initial[number][1]))
        nearest: tuple[float, int, str] | None = None
        for neighbor, other in self.table.end.items():
            if neighbor in self.table.marks | movers:
                continue
            gap = distance_between_outlines(prism.outline, other.outline)
            x, y, _ = self.table.final[neighbor][0]
            along, aside = spot[0] - x, spot[1] - y
            if gap > _NEIGHBOR or min(abs(along), abs(aside)) > _STRAIGHT:
                continue
            side = ("to the left of", "to the right of") if abs(aside) > abs(along) else ("behind", "in front of")
            word = side[(aside if abs(aside) > abs(along) else along) < 0]
            distance = _centimetres(math.hypot(along, aside))
            found = (gap, neighbor, f"{word} {self.nouns.name(neighbor)}, {distance} from centre to centre")
            nearest = min(nearest, found) if nearest else found
        if nearest is not None:
            return Place(nearest[2], (nearest[1],), spot=spot)
        return Place(describe_shift((spot[0] - start[0], spot[1] - start[1])), free=True, spot=spot)


def describe_shift(shift: Sequence[float]) -> str:
    """A displacement (x, y) in m: ``12 cm to the left and 8 cm away from the robot``; empty if it is not visible."""
    along, aside = shift
    parts = [f"{_centimetres(abs(aside))} to the {'left' if aside > 0 else 'right'}"] if abs(aside) >= SEEN else []
    if abs(along) >= SEEN:
        parts.append(f"{_centimetres(abs(along))} {'away from' if along > 0 else 'towards'} the robot")
    return " and ".join(parts)


def _centimetres(length: float) -> str:
    return f"{100 * length:.0f} cm"
