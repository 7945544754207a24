"""What the authors are told of a scene: plain JSON, rounded to millimetres, without what can be left unsaid."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from grs_agents.base import Pose
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception import types
from grs_agents.perception.proxies.meshes import inside_colliders_mask
from grs_agents.perception.types import SceneDescription, SceneObject
from grs_agents.sim.world.collision_volumes import measure_inner_size

WORKSPACE = {"x": list(types.X), "y": list(types.Y), "radius": types.FARTHEST}
"""Where the arm works: metres in the robot frame, radius from its base."""
_UPRIGHT = 0.95
"""Cosine of the tilt from which on an object that is open at the top holds things."""
_TOP, _FLAT = 0.006, 0.5
"""What is nearer to the highest point (m) is the top; on one of less than this share of the footprint things tip: a
cylinder's has 0.79."""
_TURNED = 0.005
"""An object whose extents along the robot's axes differ by more than this (m) from those along its own has both."""


def scene_for_prompt(scene: SceneDescription, library: Library) -> dict[str, Any]:
    """The objects as they stand at rest, with their relations, and the workspace (metres, robot frame, table at z = 0).

    What goes without saying is left out: ``own_size`` where it is ``size``, ``reachable`` unless it is false, and
    ``hollow``, ``floats`` and ``uneven_top`` unless they are true; library assets tell their tops by their names.
    ``cannot_be_picked`` says what went wrong when the robot tried.
    """
    objects = [_object_fields_for_prompt(item, library) for item in scene.objects]
    by_name = {told["name"]: told for told in objects}
    for relation in scene.relations:
        if relation.kind == "touching":
            by_name[relation.subject].setdefault("touching", []).append(relation.reference)
        else:
            by_name[relation.subject][relation.kind] = relation.reference
    return {"workspace": WORKSPACE, "objects": objects}


def fixture_assets_for_prompt(library: Library) -> list[dict[str, Any]]:
    """The assets that may be added to what the photo shows: containers and zones."""
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


def _object_fields_for_prompt(item: SceneObject, library: Library) -> dict[str, Any]:
    pose = item.settled or (item.position, item.orientation)
    asset, turn = library.asset(item.asset), matrix_from_quaternion(pose[1])
    upright = turn[2, 2] > _UPRIGHT
    size = np.asarray(asset.size) if item.round and upright else np.abs(turn) @ asset.size
    told: dict[str, Any] = {
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
        told["own_size"] = _round_to_three_digits(asset.size)
    told |= _pick_obstacle_fields(item)
    if asset.category == "proxy" and not asset.hollow and _flat_top_share_of_footprint(asset, pose, library) < _FLAT:
        told["uneven_top"] = True
    return told | (_hollow_fields_for_prompt(asset, library) if upright else {})


def _pick_obstacle_fields(item: SceneObject) -> dict[str, Any]:
    told = {} if item.reachable else {"reachable": False}
    if item.held:
        return told | {"floats": True}
    return told or ({"cannot_be_picked": item.pick_trouble} if item.pick_trouble else {})


def _flat_top_share_of_footprint(asset: Asset, pose: Pose, library: Library) -> float:
    """Which share of an object's footprint, as it stands, is as high as its box: of a tilted one next to nothing."""
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
    """That other things can be put in it or on it, and how much room it has inside if walls surround that."""
    inner = measure_inner_size(library.load_object_model(asset.name), library) if asset.hollow else None
    return ({"hollow": True} if asset.hollow else {}) | ({"inner_size": _round_to_three_digits(inner)} if inner else {})


def _round_to_three_digits(values: Iterable[float]) -> list[float]:
    """To three digits, whole numbers without a point."""
    return [int(value) if value == int(value) else value for value in (round(float(part), 3) for part in values)]
