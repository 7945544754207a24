"""The scene in prompts: plain JSON, rounded to millimetres, without fields at their default."""

from collections.abc import Iterable
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.base.geometry.transforms import FloatArray, transform_points, yaw_of_quaternion
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import visual_triangle_corners
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception import types
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.motion.placement import Region, find_free_spot
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import (
    collider_prisms_at_pose,
    hull_points_of_shape,
    margins_inside_outline,
    object_prism_at_pose,
)

_UPRIGHT: Final = 0.95
"""Cosine of the greatest tilt at which an object that is open at the top holds things."""
_TOP, _FLAT = 0.006, 0.5
"""Depth below the highest point that counts as the top (m), and the least share of the footprint that the top must
cover, or objects placed on it tip."""
_SNUG, _LOW = 0.001, 0.012
"""Clearance (m) at which an object goes into a container, and the height (m) above the floor within which it stands."""
_COLUMNS: Final = 20
"""Points along each side of the rectangle around a footprint at which its top is measured."""
_EDGE_ON: Final = 1e-6
"""Vertical part of a unit normal below which a plane is vertical."""
_SLOPE: Final = 0.6
"""Least share of the footprint that the sloped top of a leaning object covers: 0.65 of a leaning book, 0.9 of a leaning
carton, 0.55 of a drill's battery."""
_TURNED: Final = 0.005
"""Least difference (m) of the extents along the robot's axes and the object's own at which a prompt has both."""
_LEANING: Final = 8
"""Least angle (degrees) between the vertical and the nearest axis of an object that leans."""
_STEEP: Final = 44
"""Slope (degrees) from which on the top is a side: of half-seen cans."""
_FILLED: Final = 0.75
"""A reconstructed object leans if a tilted box around it has less than this share of an upright box's volume: shares
of upright boxes, cans and bottles in 24 photos are above 0.85."""


def scene_for_prompt(scene: SceneDescription, library: Library, farthest: float = types.FARTHEST) -> dict[str, Any]:
    """The objects at rest with their relations, and the workspace (metres, robot frame, table at z = 0), whose radius
    from the base of the arm is ``farthest``.

    Left out are ``own_size`` if it is ``size``, ``reachable`` unless it is false, and ``hollow``, ``floats`` and
    ``uneven_top`` unless they are true; the top of a library asset is known by its name. ``cannot_be_picked`` is the
    reason why the robot failed to pick the object, or why no task may use it. What ``floats`` is held in the air; what
    slides or tips off its support, and is held there, cannot be picked.
    ``fits`` names the objects outside it that the robot can pick of which each alone stands on its floor, were it
    empty.
    ``leans``: by how many degrees its nearest axis is off the vertical. ``mass`` (kg) and ``friction`` are those that a
    person set.
    """
    objects: list[dict[str, Any]] = []
    for item in scene.objects:
        pose = item.settled or (item.position, item.orientation)
        asset, turn = library.asset(item.asset), matrix_from_quaternion(pose[1])
        upright = turn[2, 2] > _UPRIGHT
        size = np.asarray(asset.size) if item.round and upright else _extents_along_robot_axes(asset, pose, library)
        fields: dict[str, Any] = {
            "name": item.name,
            "asset": item.asset,
            "description": item.description,
            "category": item.category,
            "color": item.color,
            "position": _round_to_three_digits(pose[0]),
            "orientation": _round_to_three_digits(pose[1]),
            "size": _round_to_three_digits(size),
        }
        if np.abs(size - asset.size).max() > _TURNED:
            fields["own_size"] = _round_to_three_digits(asset.size)
        if item.mass is not None:
            fields["mass"] = item.mass
        if item.friction is not None:
            fields["friction"] = item.friction
        if not item.reachable:
            fields["reachable"] = False
        below = [
            relation.reference for relation in scene.relations if (relation.subject, relation.kind) == (item.name, "on")
        ]
        if item.held and below:
            fields["cannot_be_picked"] = f"it does not stay on {' and '.join(below)} when let go, and is held there"
        elif item.held:
            fields["floats"] = True
        elif item.pick_trouble and (item.reachable or item.is_doubtful):
            fields["cannot_be_picked"] = item.pick_trouble
        top = _measure_top(asset, pose, library) if asset.category == "proxy" and not asset.hollow else None
        if top is not None and (top[:, 2] > top[:, 2].max() - _TOP).mean() < _FLAT:
            fields["uneven_top"] = True
        if lean := _lean_angle(asset, pose, library, top if "uneven_top" in fields else None):
            fields["leans"] = lean
        hollow = _hollow_fields_for_prompt(asset, library) if upright else {}
        if "inner_size" in hollow:
            within = {each.subject for each in scene.relations if (each.kind, each.reference) == ("in", item.name)}
            hollow["fits"] = [
                other.name
                for other in scene.objects
                if other.name not in within and _fits_into(other, item, hollow["inner_size"][2], library)
            ]
        objects.append(fields | hollow)
    by_name = {fields["name"]: fields for fields in objects}
    for relation in scene.relations:
        fields = by_name[relation.subject]
        if relation.kind == "touching":
            fields.setdefault("touching", []).append(relation.reference)
            by_name[relation.reference].setdefault("touching", []).append(relation.subject)
        else:
            fields[relation.kind] = relation.reference
    workspace = {"x": list(types.X), "y": list(types.Y), "radius": farthest}
    return {"workspace": workspace, "objects": objects}


def fixture_assets_for_prompt(library: Library) -> list[dict[str, Any]]:
    """The assets that may be added to those of the photo: containers and zones."""
    return [
        {
            "name": asset.name,
            "category": asset.category,
            "description": asset.description,
            "size": _round_to_three_digits(asset.size),
            **_hollow_fields_for_prompt(asset, library),
        }
        for asset in library.assets()
        if asset.fixture
    ]


def _fits_into(item: SceneObject, container: SceneObject, depth: float, library: Library) -> bool:
    """Whether the robot can pick an object and stand it on a container's floor, ``depth`` (m) below its rim."""
    if item is container or item.held or item.pick_trouble or not item.reachable:
        return False
    pose, (place, turn) = (each.settled or (each.position, each.orientation) for each in (item, container))
    body = object_prism_at_pose(library.load_object_model(item.asset), pose)
    walls = collider_prisms_at_pose(library.load_object_model(container.asset), (place, turn))
    region = Region(place[:2], library.asset(container.asset).size[:2], yaw_of_quaternion(turn))
    turns = [0.0, *(region.yaw - yaw_of_quaternion(pose[1]) + quarter for quarter in (0.0, np.pi / 2))]
    floor = max(wall.high for wall in walls) - depth

    def is_on_floor(offsets: FloatArray, heights: FloatArray) -> npt.NDArray[np.bool_]:
        return np.asarray(heights[: len(offsets)] < floor + _LOW, np.bool_)

    return find_free_spot(body, pose[0], turns, region, walls, _SNUG, is_on_floor) is not None


def _extents_along_robot_axes(asset: Asset, pose: Pose, library: Library) -> npt.NDArray[np.float64]:
    """Extents (m) along the robot's axes, even about the centre; of its box or of its colliders, if these are less."""
    prism = object_prism_at_pose(library.load_object_model(asset.name), pose)
    x, y = 2 * np.abs(prism.outline - pose[0][:2]).max(axis=0)
    z = 2 * max(prism.high - pose[0][2], pose[0][2] - prism.low)
    return np.minimum(np.abs(matrix_from_quaternion(pose[1])) @ asset.size, (x, y, z))


def _lean_angle(asset: Asset, pose: Pose, library: Library, top: FloatArray | None) -> int:
    """Angle (degrees) between the vertical and the nearest axis of an object; 0 if it stands or lies straight.

    An asset has axes of its own. Those of a reconstructed object, if its ``top`` (N, 3) is uneven, are the normal of a
    slope that most of its top lies in, or the axes of the least box around it: a straight box or can has a level top.
    """
    turn = matrix_from_quaternion(pose[1])
    if top is not None:
        if slope := _slope_of_top(top):
            return slope
        corners = visual_triangle_corners(asset.name, library).reshape(-1, 3) @ turn.T
        volume, axes = _least_box(corners, hull_half_spaces(corners)[:, :3])
        level_volume, _ = _least_box(corners, np.array([[0.0, 0.0, 1.0]]))
        if volume < _FILLED * level_volume:
            turn = axes
    angle = round(float(np.degrees(np.arccos(min(1.0, np.abs(turn[2]).max())))))
    return angle if angle >= _LEANING else 0


def _slope_of_top(top: FloatArray) -> int:
    """Slope (degrees) of the plane that most of an uneven ``top`` (N, 3) lies in; 0 without any.

    The plane falls by half of the object's height, unlike the sloped end of a carton that stands upright.
    """
    angles, azimuths = np.meshgrid(np.arange(_LEANING, _STEEP + 1, 2), np.radians(np.arange(0, 360, 10)), indexing="ij")
    tilts = np.radians(angles)
    normals = np.stack([np.sin(tilts) * np.cos(azimuths), np.sin(tilts) * np.sin(azimuths), np.cos(tilts)], axis=-1)
    best, slope = _SLOPE, 0
    for normal, angle in zip(normals.reshape(-1, 3), angles.ravel().tolist(), strict=True):
        along = top @ normal
        ordered = np.sort(along)
        counts = np.searchsorted(ordered, ordered + _TOP, side="right") - np.arange(len(ordered))
        if counts.max() <= best * len(top):
            continue
        low = ordered[counts.argmax()]
        on_plane = top[(along >= low) & (along <= low + _TOP), 2]
        if np.ptp(on_plane) >= top[:, 2].max() / 2:
            best, slope = len(on_plane) / len(top), angle
    return slope if slope < _STEEP else 0


def _least_box(
    points: npt.NDArray[np.float64], normals: npt.NDArray[np.float64]
) -> tuple[float, npt.NDArray[np.float64]]:
    """Find the least box around points (N, 3) that has a side along one of the unit normals (K, 3).

    Returns:
        Its volume (m^3), and its axes as the columns of a rotation (3, 3).
    """
    volume, axes = np.inf, np.eye(3)
    for normal in normals:
        first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        _, (width, length), angle = cv2.minAreaRect((points @ np.column_stack([first, second])).astype(np.float32))
        size = width * length * float(np.ptp(points @ normal))
        if size < volume:
            along = np.cos(np.radians(angle)) * first + np.sin(np.radians(angle)) * second
            volume, axes = size, np.column_stack([along, np.cross(normal, along), normal])
    return volume, axes


def _measure_top(asset: Asset, pose: Pose, library: Library) -> FloatArray:
    """Points (N, 3) of the top of an object's colliders, m, seen from above, even over its footprint; z from its foot.

    Points of the footprint under which no collider lies have z = 0.
    """
    model = library.load_object_model(asset.name)
    prism = object_prism_at_pose(model, pose)
    (x0, y0, x1, y1), parts = prism.bounding_box_xy, np.linspace(0.02, 0.98, _COLUMNS)
    grid = np.array([(x0 + u * (x1 - x0), y0 + v * (y1 - y0)) for u in parts for v in parts])
    grid = grid[margins_inside_outline(np.zeros((1, 2)), prism.outline, grid) > 0]
    heights = np.zeros(len(grid))
    for shape in model.colliders:
        planes = hull_half_spaces(transform_points(pose, hull_points_of_shape(shape)).T)
        over = planes[:, 3] - grid @ planes[:, :2].T
        up, down = planes[:, 2] > _EDGE_ON, planes[:, 2] < -_EDGE_ON
        ceiling, floor = ((over[:, side] / planes[side, 2]) for side in (up, down))
        level = ceiling.min(axis=1)
        inside = (level >= floor.max(axis=1)) & (over[:, ~(up | down)] >= 0).all(axis=1)
        heights = np.where(inside, np.maximum(heights, level - prism.low), heights)
    return np.column_stack([grid, heights])


def _hollow_fields_for_prompt(asset: Asset, library: Library) -> dict[str, Any]:
    """``hollow`` for an asset that holds objects in it or on it, with its inner size if walls surround that."""
    inner = measure_inner_size(library.load_object_model(asset.name), library) if asset.hollow else None
    return ({"hollow": True} if asset.hollow else {}) | ({"inner_size": _round_to_three_digits(inner)} if inner else {})


def _round_to_three_digits(values: Iterable[float]) -> list[float]:
    """Round to three digits; whole numbers have no decimal point."""
    return [int(value) if value == int(value) else value for value in (round(float(part), 3) for part in values)]
