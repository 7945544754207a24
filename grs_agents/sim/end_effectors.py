"""End effectors: the tools at the end of the arm, and the action that each carries out between two poses of its tip."""

from dataclasses import dataclass
from typing import Final, Protocol

from grs_agents.base import Pose
from grs_agents.sim.instance.episode import Outcome
from grs_agents.sim.instance.task_instance import Primitive
from grs_agents.sim.motion.pick_place import PickPlaceResult
from grs_agents.sim.motion.push import PushResult
from grs_agents.sim.world.spec import Tool


@dataclass(frozen=True)
class ActionEffect:
    """Effect of an action of the end effector."""

    object: int | None  # id of the object picked, or pushed farthest
    note: str  # one clause on how it went
    trouble: Outcome | None = None  # kind of failure, if it has a name
    pushed: tuple[int, ...] = ()  # ids of the objects pushed, farthest first


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


class SuctionCup:
    """Suction cup: picks at the first pose, places at the second."""

    tool: Tool = "suction"
    primitive: Primitive = "pick_place"

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Pick and place."""
        result = sim.pick_place(start, end)
        return ActionEffect(result.grasped, result.note, result.trouble)


class Blade:
    """Spatula: pushes along the table from the first pose towards the second, picks nothing up."""

    tool: Tool = "spatula"
    primitive: Primitive = "push"

    def act(self, sim: Workbench, start: Pose, end: Pose) -> ActionEffect:
        """Push."""
        result = sim.push(start, end)
        return ActionEffect(next(iter(result.pushed), None), result.note, pushed=result.pushed)


END_EFFECTORS: Final[dict[Primitive, type[SuctionCup] | type[Blade]]] = {"pick_place": SuctionCup, "push": Blade}
"""The end effector of each primitive."""
