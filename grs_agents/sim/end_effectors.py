"""End effectors: the tools at the end of the arm, their grasps, and the action of each between two poses of its tip."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.hands.hand import DEFAULT_HAND, Tool
from grs_agents.sim.hands.registry import get_tool
from grs_agents.sim.instance.episode import Outcome
from grs_agents.sim.instance.task_instance import Primitive
from grs_agents.sim.motion.finger_grasps import find_finger_grasps
from grs_agents.sim.motion.grasp import find_grasp
from grs_agents.sim.motion.hand_room import HandRoom
from grs_agents.sim.motion.pick_place import PickPlaceResult
from grs_agents.sim.motion.push import PushResult
from grs_agents.sim.world.footprints import Prism
from grs_agents.sim.world.physics import Physics


@dataclass(frozen=True)
class ActionEffect:
    """Effect of an action of the end effector."""

    object: int | None  # id of the object picked, or pushed farthest
    note: str  # one clause on how it went
    trouble: Outcome | None = None  # kind of failure, if it has a name
    pushed: tuple[int, ...] = ()  # ids of the objects pushed, farthest first


@dataclass(frozen=True)
class Grasps:
    """Poses of the tip that take an object, best first, or the reason for none."""

    poses: tuple[Pose, ...]
    hindered_by: tuple[int, ...] = ()  # ids of the objects in the way of all, most frequent first
    covered_by: frozenset[int] = frozenset()  # of these the objects on top of it
    trouble: Outcome | None = None
    why: str = ""  # a clause with ``{name}`` for the object


class Workbench(Protocol):
    """Motions of the arm that end effectors use; ``TabletopSim`` has them."""

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another."""
        ...

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Push along the table from one pose towards another."""
        ...


class EndEffector(Protocol):
    """Tool at the end of the arm."""

    @property
    def tool(self) -> Tool:
        """Name under which the spec of a world builds it."""
        ...

    @property
    def primitive(self) -> Primitive:
        """Name of its action in task instances."""
        ...

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Carry out an action between two poses of the tip."""
        ...

    def find_grasps(
        self, physics: Physics, number: int, outline: Prism, others: Sequence[Prism], wanted: int = 1
    ) -> Grasps:
        """Grasps of an object as it stands, for any place.

        Args:
            physics: the running world.
            number: id of the object.
            outline: its prism.
            others: prisms of all other objects.
            wanted: how many unlike grasps end a search; there may be fewer.
        """
        ...

    def find_grasps_for_place(
        self, physics: Physics, number: int, grasps: Grasps, carry: Callable[[Pose], Pose], wanted: int = 1
    ) -> Grasps:
        """Grasps that also serve where the object is let go.

        Args:
            physics: the running world.
            number: id of the object.
            grasps: those found for any place.
            carry: pose of the tip at the place, from the pose that takes the object.
            wanted: as for ``find_grasps``.
        """
        ...


class SuctionCup:
    """Suction cup: picks at the first pose, places at the second."""

    tool: Tool = "suction"
    primitive: Primitive = "pick_place"

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Pick and place."""
        result = sim.pick_place(start, end)
        return ActionEffect(result.grasped, result.note, result.trouble)

    def find_grasps(
        self, physics: Physics, number: int, outline: Prism, others: Sequence[Prism], wanted: int = 1
    ) -> Grasps:
        """The best point on top of an object."""
        del wanted
        hold = find_grasp(physics, number, outline, others)
        if hold.point is not None:
            return Grasps(((hold.point, transforms.IDENTITY),))
        why = "is flat and wide enough for the cup to seal"
        if hold.trouble == "would_tip":
            why = "is so near to the middle of its weight that it would not tip off the cup"
        why = "" if hold.hindered_by else f"no place on top of {{name}} {why}"
        return Grasps((), hold.hindered_by, hold.covered_by, hold.trouble, why)

    def find_grasps_for_place(
        self, physics: Physics, number: int, grasps: Grasps, carry: Callable[[Pose], Pose], wanted: int = 1
    ) -> Grasps:
        """The given grasps: a cup is above the object that it holds."""
        del physics, number, carry, wanted
        return grasps


class Blade:
    """Spatula: pushes along the table from the first pose towards the second, picks nothing up."""

    tool: Tool = "spatula"
    primitive: Primitive = "push"

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Push."""
        result = sim.push(start, end)
        return ActionEffect(next(iter(result.pushed), None), result.note, pushed=result.pushed)

    def find_grasps(
        self, physics: Physics, number: int, outline: Prism, others: Sequence[Prism], wanted: int = 1
    ) -> Grasps:
        """None: a blade picks nothing up."""
        del physics, number, outline, others, wanted
        return Grasps((), trouble="unreachable", why="the spatula pushes, it does not pick {name} up")

    def find_grasps_for_place(
        self, physics: Physics, number: int, grasps: Grasps, carry: Callable[[Pose], Pose], wanted: int = 1
    ) -> Grasps:
        """None, as ``find_grasps``."""
        del physics, number, carry, wanted
        return grasps


class TwoFingers:
    """Two fingers: close on what is between them at the first pose, and open at the second."""

    tool: Tool = "fingers"
    primitive: Primitive = "pick_place"

    def __init__(self) -> None:
        self._room: tuple[Physics, HandRoom] | None = None

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Pick and place."""
        result = sim.pick_place(start, end)
        return ActionEffect(result.grasped, result.note, result.trouble)

    def find_grasps(
        self, physics: Physics, number: int, outline: Prism, others: Sequence[Prism], wanted: int = 1
    ) -> Grasps:
        """Antipodal grasps with room for the hand, from above if there are any."""
        del outline, others
        return self._find_grasps(physics, number, None, wanted)

    def find_grasps_for_place(
        self, physics: Physics, number: int, grasps: Grasps, carry: Callable[[Pose], Pose], wanted: int = 1
    ) -> Grasps:
        """Antipodal grasps with room at the place, too, for the fingers to open and draw back."""
        del grasps
        return self._find_grasps(physics, number, carry, wanted)

    def _find_grasps(self, physics: Physics, number: int, carry: Callable[[Pose], Pose] | None, wanted: int) -> Grasps:
        found = find_finger_grasps(physics, self._look(physics), number, carry, wanted)
        poses = tuple(grasp.pose for grasp in found.grasps)
        return Grasps(poses, found.covered_by, trouble=found.trouble, why=found.why)

    def _look(self, physics: Physics) -> HandRoom:
        if self._room is None or self._room[0] is not physics:
            self._room = physics, HandRoom(physics)
        self._room[1].look(physics)
        return self._room[1]


END_EFFECTORS: Final[dict[Primitive, type[SuctionCup] | type[Blade]]] = {"pick_place": SuctionCup, "push": Blade}
"""The end effector of each primitive, with the default hand."""


def make_end_effector(primitive: Primitive, hand: str = DEFAULT_HAND) -> EndEffector:
    """The end effector of a primitive, by the configured name of the robot's hand; pushing takes the spatula."""
    if primitive == "pick_place" and get_tool(hand) == "fingers":
        return TwoFingers()
    return END_EFFECTORS[primitive]()
