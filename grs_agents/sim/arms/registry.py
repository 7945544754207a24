"""Robots by configured name: ``ur5e``, ``panda``, or the path of a user's MJCF file."""

from functools import lru_cache
from pathlib import Path
from typing import Final

from grs_agents.base.errors import UnknownNameError
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.mjcf_arm import load_arm
from grs_agents.sim.arms.panda import Panda
from grs_agents.sim.arms.ur5e import UR5e

ROBOTS: Final = {"ur5e": UR5e, "panda": Panda}
DEFAULT: Final = "ur5e"


@lru_cache(maxsize=8)
def get_arm(robot: str = DEFAULT) -> Arm:
    """The arm of a name or of an MJCF file, created once per process.
    Raises ``UnknownNameError`` for an unknown name, ``InputError`` for an unusable file."""
    if robot in ROBOTS:
        return ROBOTS[robot]()
    if Path(robot).suffix.lower() not in (".xml", ".mjcf"):
        raise UnknownNameError("robot", robot, (*ROBOTS, "path/to/arm.xml"))
    return load_arm(Path(robot))
