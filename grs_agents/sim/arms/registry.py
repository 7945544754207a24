"""Robots by configured name: ``ur5e``, ``panda``, or the path of a user's MJCF or URDF file."""

from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Final

from grs_agents.base.errors import GrsError, InputError, UnknownNameError
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.mjcf_arm import load_arm
from grs_agents.sim.arms.panda import Panda
from grs_agents.sim.arms.ur5e import UR5e
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.hands.registry import HANDS, OWN_HAND, get_hand

ROBOTS: Final = {"ur5e": UR5e, "panda": Panda}
DEFAULT: Final = "ur5e"


def prepare_arm(robot: str, hand: str) -> None:
    """Load an arm for the processes that are forked from this one; an unusable one is for them to refuse."""
    with suppress(GrsError):
        _ = get_arm(robot, hand).farthest


@lru_cache(maxsize=16)
def get_arm(robot: str = DEFAULT, hand: str = DEFAULT_HAND) -> Arm:
    """The arm of a name or of an MJCF or URDF file, with a hand, created once per process.
    Raises ``UnknownNameError`` for an unknown name, ``InputError`` for an unusable file."""
    if robot in ROBOTS:
        if hand == OWN_HAND:
            raise InputError(f"robot {robot} has no hand of its own", f"name one: {', '.join(HANDS)}")
        return ROBOTS[robot](get_hand(hand))
    if Path(robot).suffix.lower() not in (".xml", ".mjcf", ".urdf"):
        raise UnknownNameError("robot", robot, (*ROBOTS, "path/to/arm.xml"))
    return load_arm(Path(robot), None if hand == OWN_HAND else get_hand(hand))
