"""The scene as the prompts tell it: plain JSON with rounded numbers."""

from typing import Any

from grs_agents.library import Library
from grs_agents.perception import SceneDescription, types

WORKSPACE = {"x": list(types.X), "y": list(types.Y), "radius": types.FARTHEST}
"""Where the arm works: metres in the robot frame, radius from its base."""


def scene_for_prompt(scene: SceneDescription, library: Library) -> dict[str, Any]:
    """Each object with its asset, place and size (metres, robot frame, table top at z = 0)."""
    objects = [
        {
            "name": thing.name,
            "asset": thing.asset,
            "description": thing.description,
            "category": thing.category,
            "color": thing.color,
            "position": _rounded(thing.position),
            "orientation": _rounded(thing.orientation, 4),
            "size": _rounded(thing.size),
            "box": {"low": _rounded(thing.box.low), "high": _rounded(thing.box.high)},
            "reachable": thing.reachable,
            "hollow": library.asset(thing.asset).hollow,
        }
        for thing in scene.objects
    ]
    return {"objects": objects, "workspace": WORKSPACE}


def fixtures_for_prompt(library: Library) -> list[dict[str, Any]]:
    """The assets that may be added to what the photo shows: containers and zones."""
    return [
        {
            "name": asset.name,
            "category": asset.category,
            "description": asset.description,
            "size": _rounded(asset.size),
            "hollow": asset.hollow,
        }
        for asset in library.assets()
        if asset.fixture
    ]


def _rounded(values: tuple[float, ...], digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in values]
