"""Register a matched asset to an object's points: from several turns, by what the camera saw and could see through."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.scene.candidates import place_asset, quaternion
from grs_agents.scene.frame import Array, Mask, RGBDFrame
from grs_agents.scene.points import Cloud, Tree, align
from grs_agents.scene.sighting import Sighting, cost, residual, sighting_of
from grs_agents.scene.surface import Surface, surface_of
from grs_agents.scene.symmetry import Symmetry, quarter_turns, symmetry_of
from grs_agents.scene.types import PoseMethod, TableFrame, UprightBox

FEWEST = 30
"""An object of fewer points is left where its box puts it."""
TRIED = 5
"""So many of the turns are aligned; the others look worse from the start."""
REACH = 0.03
"""Partners of an alignment are at most so far apart, m."""
LYING = 0.0015
TILTED = 0.001
"""A pose that is not upright, or rests on none of its sides, has to fit better by so much, m."""
BETTER = 0.0003
"""A registered pose that fits no better than the box by so much (m) is not taken."""
LEANING = math.radians(12)
"""What leans less than this stands straight, unless it fits better leaning."""
WORST = 0.015
"""A residual above this (m) is no fit."""


@dataclass(frozen=True)
class Registered:
    """Where an asset stands.

    Attributes:
        position: centre of its bounding box, m, robot frame.
        orientation: xyzw.
        size: extents along the axes after the turn, before the yaw, m.
        residual: how far the object's points are off its surface: mean of the nearest 90 %, m.
        method: ``registered``, or ``box`` where that fits no worse.
        round: it looks the same at any yaw.
    """

    position: Vec3
    orientation: Quat
    size: Vec3
    residual: float
    method: PoseMethod
    round: bool


@dataclass(frozen=True)
class _Search:
    """An asset's surface, and what was seen of the object."""

    surface: Surface
    tree: Tree
    seen: Sighting
    bottom: float

    def cost(self, pose: Array) -> float:
        """What `sighting.cost` says, and what is unlikely about the pose, m."""
        turn = pose[:3, :3]
        lying = LYING * (turn[2, 2] < 0.9)
        tilted = TILTED * (np.abs(turn[2]).max() < math.cos(math.radians(0.1)))
        return cost(self.surface, self.tree, pose, self.seen) + float(lying + tilted)


def register(
    asset: str, library: Library, upright: UprightBox, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> Registered:
    """Lay an asset into the points of a mask (H, W).

    Args:
        asset: a library name.
        library: where it is looked up.
        upright: the box measured of the object, where the search begins.
        frame, table: the photo and its pose.
        mask: the object's pixels.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    position, orientation, size = place_asset(upright, library.asset(asset).size)
    begin = _pose(rotation_matrix(orientation), np.array(position))
    surface, symmetry, seen = surface_of(asset, library), symmetry_of(asset, library), sighting_of(frame, table, mask)
    search = _Search(surface, Tree(surface.points), seen, upright.center[2] - upright.size[2] / 2)
    if len(seen.points) < FEWEST:
        return Registered(position, orientation, size, 0.0, "box", _is_round(begin, symmetry))
    best = _searched(search, upright, symmetry)
    off = residual(surface, search.tree, best, seen)
    if search.cost(best) > search.cost(begin) - BETTER or off > WORST:
        off = residual(surface, search.tree, begin, seen)
        return Registered(position, orientation, size, off, "box", _is_round(begin, symmetry))
    x, y, z = (float(value) for value in best[:3, 3])
    extents = _extents(best[:3, :3], surface)
    return Registered((x, y, z), quaternion(best[:3, :3]), extents, off, "registered", _is_round(best, symmetry))


def _is_round(pose: Array, symmetry: Symmetry) -> bool:
    return any(abs(float(pose[2, :3] @ axis)) > math.cos(math.radians(5)) for axis in symmetry.axes)


def _extents(turn: Array, surface: Surface) -> Vec3:
    """Extents along the world's axes once the yaw is taken back, for a turn that may lean."""
    up = int(np.argmax(np.abs(turn[2])))
    side = turn[:, (up + 1) % 3]
    yaw = math.atan2(side[1], side[0])
    yaw -= round(yaw / (math.pi / 2)) * math.pi / 2
    x, y, z = (float(value) for value in 2 * np.abs(_about_z(-yaw) @ turn) @ surface.half)
    return (x, y, z)


def _searched(search: _Search, upright: UprightBox, symmetry: Symmetry) -> Array:
    """The pose (4, 4) that costs least."""
    starts = sorted(_starts(search, upright, symmetry), key=search.cost)[:TRIED]
    source = Cloud(search.seen.points)
    aligned = [_aligned(search, start, source) for start in starts]
    poses = [*starts[:2], *aligned, *(straight for one in aligned if (straight := _straight(one, search)) is not None)]
    best = sorted(poses, key=search.cost)[:3]
    return min((_refined(one, search) for one in best), key=search.cost)


def _starts(search: _Search, upright: UprightBox, symmetry: Symmetry) -> list[Array]:
    """Every side up, at the yaws of the box and between them, each look once; resting on the box's bottom."""
    found: list[Array] = []
    for between in (0.0, math.pi / 4):
        tried: list[Array] = []
        for turn in quarter_turns():
            if any(_same(turn, other, symmetry) for other in tried):
                continue
            tried.append(turn)
            whole = _about_z(upright.yaw + between) @ turn
            height = float(np.abs(turn[2]) @ search.surface.half)
            found.append(_pose(whole, np.array([*upright.center[:2], search.bottom + height])))
    return found


def _same(turn: Array, other: Array, symmetry: Symmetry) -> bool:
    """Whether both turns look alike."""
    return symmetry.angle(turn, other) < 1.0


def _aligned(search: _Search, start: Array, source: Cloud) -> Array:
    """Align the points with the part of the surface that the camera sees at the pose before, twice."""
    pose = start
    for reach in (REACH, REACH / 2):
        turn = pose[:3, :3]
        points = search.surface.points @ turn.T + pose[:3, 3]
        facing = np.einsum("ni,ni->n", search.surface.normals @ turn.T, points - search.seen.eye) < 0
        if facing.sum() < FEWEST:
            return pose
        target = Cloud(search.surface.points[facing])
        pose = _inverse(align(target, source, _inverse(pose), reach))
    return pose


def _inverse(pose: Array) -> Array:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _straight(pose: Array, search: _Search) -> Array | None:
    """The pose on the side it nearly rests on, at the height of what it rests on; ``None`` where it leans."""
    turn = pose[:3, :3]
    up = int(np.argmax(np.abs(turn[2])))
    axis = turn[:, up] * np.sign(turn[2, up])
    angle = math.acos(min(1.0, float(axis[2])))
    if angle > LEANING:
        return None
    cross = np.cross(axis, (0.0, 0.0, 1.0))
    whole = _turn(cross, angle) @ turn
    height = float(np.abs(whole[2]) @ search.surface.half)
    bottom = float(pose[2, 3]) - height
    rests = abs(bottom - search.bottom) < 0.015
    return _pose(whole, np.array([pose[0, 3], pose[1, 3], (search.bottom if rests else bottom) + height]))


def _refined(pose: Array, search: _Search) -> Array:
    """Shift and turn about z in ever smaller steps for as long as it costs less."""
    best, least = pose, search.cost(pose)
    for shift, angle in ((0.008, 0.16), (0.004, 0.08), (0.002, 0.04), (0.001, 0.02)):
        for move in (*_shifts(shift), *(angle * np.array([0, 0, 0, sign]) for sign in (1, -1))):
            for _ in range(3):
                tried = _pose(_about_z(float(move[3])) @ best[:3, :3], best[:3, 3] + move[:3])
                if (value := search.cost(tried)) >= least:
                    break
                best, least = tried, value
    return best


def _shifts(length: float) -> Sequence[Array]:
    return [sign * length * np.eye(4)[axis] for axis in range(3) for sign in (1, -1)]


def _pose(turn: Array, shift: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


def _about_z(yaw: float) -> Array:
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])


def _turn(axis: Array, angle: float) -> Array:
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
