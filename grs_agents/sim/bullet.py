"""A few read-only calls under PyBullet's names, on the most recent environment; ``from grs_agents.sim import p``."""

from typing import TYPE_CHECKING, Any

from grs_agents.base import Quat, Vec3
from grs_agents.sim import utils
from grs_agents.sim.episode import SimulationError

if TYPE_CHECKING:
    from grs_agents.sim.environment import Environment

_current: "list[Environment]" = []


def attach(env: "Environment") -> None:
    """Make ``env`` the environment that the calls below read."""
    _current[:] = [env]


def _environment() -> "Environment":
    if not _current:
        raise SimulationError("p.* was called before any Environment was made", "make an Environment first")
    return _current[-1]


def getBasePositionAndOrientation(bodyUniqueId: int, *_: Any, **__: Any) -> tuple[Vec3, Quat]:
    """Position (m) of an object's centre and its rotation (xyzw)."""
    return _environment().get_object_pose(bodyUniqueId)


def getAABB(bodyUniqueId: int, *_: Any, **__: Any) -> tuple[Vec3, Vec3]:
    """Lowest and highest corner of an object as it stands, metres."""
    prism = _environment().outline(bodyUniqueId)
    x0, y0, x1, y1 = prism.box
    return (x0, y0, prism.low), (x1, y1, prism.high)


def changeVisualShape(objectUniqueId: int, linkIndex: int = -1, rgbaColor: Any = None, **_: Any) -> None:
    """Recolour an object."""
    del linkIndex
    if rgbaColor is not None:
        _environment().set_color(objectUniqueId, rgbaColor)


def getEulerFromQuaternion(quaternion: Quat) -> Vec3:
    """(x, y, z, w) to roll, pitch, yaw in radians."""
    return utils.quatXYZW_to_eulerXYZ(quaternion)


def getQuaternionFromEuler(eulerAngles: Vec3) -> Quat:
    """Roll, pitch, yaw in radians to (x, y, z, w)."""
    return utils.eulerXYZ_to_quatXYZW(eulerAngles)


def stepSimulation(*_: Any) -> None:
    """Simulate one time step."""
    _environment().step_simulation()
