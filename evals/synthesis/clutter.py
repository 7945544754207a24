"""A heap on a table: objects standing, lying, leaning and stacked, dropped by physics and at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.errors import GrsError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion, quaternion_from_rpy
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.compilation import build_world, reset_world_to_poses

Floats = npt.NDArray[np.float64]
CENTER: Final = (0.5, 0.0)
REACH: Final = 0.40
"""Everything comes to rest within this distance (m) of the middle of the heap."""
_GAP: Final = 0.003
_ATTEMPTS: Final = 12
_LONGEST: Final = 5.0
"""Simulated seconds in which everything has to come to rest."""
_STILL: Final = 0.01
"""Speed below which an object rests, m/s."""
_CHUNK: Final = 50
"""Simulation steps between two checks for rest."""
_STACKED: Final = 0.3
"""Share of the objects that are stacked on others; another tenth is dropped in any orientation."""
_HIGHEST: Final = 0.14
"""Largest height of an object that others are stacked on, m."""
_CEILING: Final = 0.8
"""Nothing is dropped from higher than this (m)."""
_SPREAD: Final = (0.14, 0.24)
"""Radius of the patch of table with the initial positions, m."""


class SynthesisError(GrsError):
    """A scene could not be made."""


@dataclass(frozen=True)
class RestingObject:
    """An object at rest: its asset, and its pose (position in m, rotation xyzw) in the robot frame."""

    asset: str
    pose: Pose


def settle_heap(assets: Sequence[str], library: Library, rng: np.random.Generator) -> tuple[RestingObject, ...]:
    """Drop objects into a heap around `CENTER` and let them come to rest.

    Args:
        assets: a name for each object.
        library: of the assets.
        rng: source of the arrangement.

    Raises:
        SynthesisError: in every arrangement tried, an object left the heap.
    """
    for _ in range(_ATTEMPTS):
        dropped = _arranged(assets, library, rng)
        poses = _settled(dropped, library) if dropped else None
        if poses is not None:
            return tuple(RestingObject(asset, pose) for asset, pose in zip(assets, poses, strict=True))
    raise SynthesisError(
        f"{len(assets)} things did not come to rest within {REACH} m in {_ATTEMPTS} attempts", "ask for fewer objects"
    )


def _arranged(assets: Sequence[str], library: Library, rng: np.random.Generator) -> list[InstanceObject]:
    """Poses without contact, each object above its later support; the widest objects come first.

    Returns:
        None if they would be piled up too high.
    """
    widest = sorted(range(len(assets)), key=lambda index: -float(np.prod(library.asset(assets[index]).size[:2])))
    spread = float(rng.uniform(*_SPREAD))
    placed: list[tuple[Floats, Floats, float]] = []
    items: dict[int, InstanceObject] = {}
    for order, index in enumerate(widest):
        bounds = np.array(library.load_object_model(assets[index]).bounds)
        upper = order >= (1 - _STACKED) * len(assets)
        standing = library.asset(assets[index]).hollow
        turned = _rotation(rng, standing, any_way=upper and bool(rng.random() < _STACKED))
        corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T @ matrix_from_quaternion(turned).T
        low, high = corners.min(axis=0), corners.max(axis=0)
        lower = [box for box in placed if box[2] < _HIGHEST]
        x, y = _spot(low, high, lower if upper and lower else placed, spread, upper, rng)
        shift = np.array([x, y, 0.0])
        under = [top for (least, most, top) in placed if _over(low + shift, high + shift, least, most)]
        shift[2] = max(under, default=0.0) + _GAP - low[2]
        if shift[2] > _CEILING:
            return []
        placed.append((low + shift, high + shift, float((high + shift)[2])))
        position: Vec3 = (float(shift[0]), float(shift[1]), float(shift[2]))
        items[index] = InstanceObject(id=index, asset=assets[index], pose=(position, turned))
    return [items[index] for index in range(len(assets))]


def _rotation(rng: np.random.Generator, standing: bool, any_way: bool) -> Quat:
    """Upright, on a side, or any way up; with any yaw."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    if standing:
        return quaternion_from_rpy(0.0, 0.0, yaw)
    if any_way:
        roll, pitch = (float(angle) for angle in rng.uniform(-np.pi, np.pi, 2))
        return quaternion_from_rpy(roll, pitch, yaw)
    side = rng.choice(3, p=[0.66, 0.17, 0.17])
    return quaternion_from_rpy(np.pi / 2 if side == 1 else 0.0, np.pi / 2 if side == 2 else 0.0, yaw)


def _spot(
    low: Floats,
    high: Floats,
    placed: Sequence[tuple[Floats, Floats, float]],
    spread: float,
    upper: bool,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Position of an object: near the middle if free, or over another object."""
    if upper:
        least, most, _ = placed[int(rng.integers(len(placed)))]
        x, y, _ = least + (most - least) * rng.uniform(0.35, 0.65, 3)
        return float(x), float(y)
    x, y = CENTER
    for attempt in range(60):
        angle, radius = rng.uniform(-np.pi, np.pi), spread * (1 + attempt / 60) * np.sqrt(rng.random())
        x, y = CENTER[0] + radius * np.cos(angle), CENTER[1] + radius * np.sin(angle)
        shift = np.array([x, y, 0.0])
        if not any(_over(low + shift - _GAP, high + shift + _GAP, least, most) for least, most, _ in placed):
            break
    return float(x), float(y)


def _over(low: Floats, high: Floats, least: Floats, most: Floats) -> bool:
    return bool((low[:2] < most[:2]).all() and (high[:2] > least[:2]).all())


def _settled(items: Sequence[InstanceObject], library: Library) -> list[Pose] | None:
    """Poses of all objects at rest; None if an object rolled away or does not come to rest."""
    world = build_world(items, library)
    reset_world_to_poses(world, items)
    model, data = world.model, world.data
    owners = np.asarray(world.owners)
    robot = owners < 0  # its geoms collide with nothing
    robot[model.geom("table").id] = False
    model.geom_contype[robot], model.geom_conaffinity[robot] = 0, 0
    model.geom_condim[owners >= 0] = 6  # damping, so that rolling objects come to rest
    model.geom_friction[owners >= 0, 2] = 0.004
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.impratio = 1.0
    first, still = world.arm.dof, 0
    for _ in range(int(_LONGEST / model.opt.timestep / _CHUNK)):
        mujoco.mj_step(model, data, _CHUNK)
        speed = np.abs(data.qvel[first:].reshape(-1, 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
        still = still + 1 if speed.max(initial=0.0) < _STILL else 0
        if still == 3:
            break
    else:
        return None
    poses = [_pose(data, world.bodies[item.id]) for item in items]
    offsets = np.array([position for position, _ in poses]) - (*CENTER, 0.0)
    inside = (np.linalg.norm(offsets[:, :2], axis=1) < REACH).all() and (offsets[:, 2] > 0).all()
    return poses if inside else None


def _pose(data: Any, body: int) -> Pose:
    x, y, z = (float(value) for value in data.xpos[body])
    w, i, j, k = (float(value) for value in data.xquat[body])
    return (x, y, z), (i, j, k, w)
