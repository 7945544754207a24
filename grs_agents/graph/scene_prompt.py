"""The scene in prompts: plain JSON, rounded to millimetres, without fields at their default."""

from collections.abc import Iterable
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import visual_triangle_corners
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception import types
from grs_agents.perception.proxies.meshes import inside_colliders_mask
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.footprints import object_prism_at_pose

_UPRIGHT: Final = 0.95
"""Cosine of the greatest tilt at which an object that is open at the top holds things."""
_TOP, _FLAT = 0.006, 0.5
"""Depth below the highest point that counts as the top (m), and the least share of the footprint that the top must
cover, or objects placed on it tip; the top of a standing cylinder covers 0.79."""
_TURNED: Final = 0.005
"""Least difference (m) of the extents along the robot's axes and the object's own at which a prompt has both."""
_LEANING: Final = 8
"""Least angle (degrees) between the vertical and the nearest axis of an object that leans."""
_FILLED: Final = 0.75
"""A reconstructed object leans if a tilted box around it has less than this share of an upright box's volume: shares
of upright boxes, cans and bottles in 24 photos are above 0.85."""


def scene_for_prompt(scene: SceneDescription, library: Library, farthest: float = types.FARTHEST) -> dict[str, Any]:
    """The objects at rest with their relations, and the workspace (metres, robot frame, table at z = 0), whose radius
    from the base of the arm is ``farthest``.

    Left out are ``own_size`` if it is ``size``, ``reachable`` unless it is false, and ``hollow``, ``floats`` and
    ``uneven_top`` unless they are true; the top of a library asset is known by its name. ``cannot_be_picked`` is the
    reason why the robot failed to pick the object, or why no task may use it. What floats is on nothing that is known.
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
        if item.held:
            fields["floats"] = True
        elif item.pick_trouble and (item.reachable or item.is_doubtful):
            fields["cannot_be_picked"] = item.pick_trouble
        is_proxy = asset.category == "proxy" and not asset.hollow
        if is_proxy and _flat_top_share_of_footprint(asset, pose, library) < _FLAT:
            fields["uneven_top"] = True
        if lean := _lean_angle(asset, pose, library, is_proxy and "uneven_top" in fields):
            fields["leans"] = lean
        objects.append(fields | (_hollow_fields_for_prompt(asset, library) if upright else {}))
    by_name = {fields["name"]: fields for fields in objects}
    for relation in scene.relations:
        fields = by_name[relation.subject]
        if relation.kind == "touching" or (relation.kind == "on" and "floats" in fields):
            fields.setdefault("touching", []).append(relation.reference)
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


def _extents_along_robot_axes(asset: Asset, pose: Pose, library: Library) -> npt.NDArray[np.float64]:
    """Extents (m) along the robot's axes, even about the centre; of its box or of its colliders, if these are less."""
    prism = object_prism_at_pose(library.load_object_model(asset.name), pose)
    x, y = 2 * np.abs(prism.outline - pose[0][:2]).max(axis=0)
    z = 2 * max(prism.high - pose[0][2], pose[0][2] - prism.low)
    return np.minimum(np.abs(matrix_from_quaternion(pose[1])) @ asset.size, (x, y, z))


def _lean_angle(asset: Asset, pose: Pose, library: Library, is_uneven: bool) -> int:
    """Angle (degrees) between the vertical and the nearest axis of an object; 0 if it stands or lies straight.

    An asset has axes of its own; those of a reconstructed object are those of the least box around it, if
    ``is_uneven``, since a straight box or can has a level top.
    """
    turn = matrix_from_quaternion(pose[1])
    if is_uneven:
        corners = visual_triangle_corners(asset.name, library).reshape(-1, 3) @ turn.T
        volume, axes = _least_box(corners, hull_half_spaces(corners)[:, :3])
        level_volume, _ = _least_box(corners, np.array([[0.0, 0.0, 1.0]]))
        if volume < _FILLED * level_volume:
            turn = axes
    angle = round(float(np.degrees(np.arccos(min(1.0, np.abs(turn[2]).max())))))
    return angle if angle >= _LEANING else 0


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


def _flat_top_share_of_footprint(asset: Asset, pose: Pose, library: Library) -> float:
    """Share of the footprint of an object in its pose at which it reaches the height of its box; near 0 if tilted."""
    model, turn = library.load_object_model(asset.name), matrix_from_quaternion(pose[1])
    low, high = np.array(model.bounds)
    half = np.abs(turn) @ (high - low) / 2
    across = np.linspace(-0.97, 0.97, 12)
    columns = np.array([(x, y) for x in across * half[0] for y in across * half[1]])
    covered = np.zeros(len(columns), np.bool_)
    for depth in (0.0005, _TOP / 2, _TOP):
        points = np.column_stack([columns, np.full(len(columns), half[2] - depth)]) @ turn + (low + high) / 2
        covered |= inside_colliders_mask(model, library, points)
    return float(covered.mean())


def _hollow_fields_for_prompt(asset: Asset, library: Library) -> dict[str, Any]:
    """``hollow`` for an asset that holds objects in it or on it, with its inner size if walls surround that."""
    inner = measure_inner_size(library.load_object_model(asset.name), library) if asset.hollow else None
    return ({"hollow": True} if asset.hollow else {}) | ({"inner_size": _round_to_three_digits(inner)} if inner else {})


def _round_to_three_digits(values: Iterable[float]) -> list[float]:
    """Round to three digits; whole numbers have no decimal point."""
    return [int(value) if value == int(value) else value for value in (round(float(part), 3) for part in values)]
