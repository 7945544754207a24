"""What the authors are told of a scene."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.graph.scene_prompt import fixture_assets_for_prompt, scene_for_prompt
from grs_agents.library.library import Library
from grs_agents.library.shapes import quaternion_from_rpy
from grs_agents.perception.proxies.proxy import Proxy, write_proxy
from grs_agents.perception.shapes.colliders import Hull
from grs_agents.perception.shapes.types import ObjectMesh
from grs_agents.perception.types import SceneDescription

LIBRARY = Library()
FRAME: dict[str, Any] = {"T_robot_cam": ((1.0,),), "origin": "calibrated", "residual": 0.0, "inliers": 1.0}
FLAT = (0.0, 0.0, 0.0, 1.0)


def thing(
    name: str, asset: str, x: float, z: float, yaw: float = 0.0, library: Library = LIBRARY, **fields: Any
) -> dict[str, Any]:
    """An object of a scene whose measured box tells nothing."""
    words = {"description": f"a {name}", "category": "thing", "color": "red", "evidence": "", "mask": "m", "crop": "c"}
    turned = {"position": (x, 0.0, z), "orientation": quaternion_from_rpy(0.0, 0.0, yaw), "reachable": True}
    box = {"low": (0.0, 0.0, 0.0), "high": (1.0, 1.0, 1.0)}
    size = library.asset(asset).size
    return {
        "id": 1,
        "name": name,
        "asset": asset,
        "matched": True,
        "size": size,
        "box": box,
        **words,
        **turned,
        **fields,
    }


def told(
    *objects: dict[str, Any], relations: tuple[dict[str, str], ...] = (), library: Library = LIBRARY
) -> dict[str, dict[str, Any]]:
    """What a prompt says of each object, by its name."""
    scene = {"source": "s", "image": "i", "frame": FRAME, "objects": objects, "relations": relations}
    found = scene_for_prompt(SceneDescription.model_validate(scene), library)
    assert found["workspace"]["radius"] == 0.85
    return {item["name"]: item for item in found["objects"]}


def test_only_what_does_not_go_without_saying_is_said() -> None:
    milk = told(thing("milk", "HOPE/Milk.urdf", 0.4, 0.095))["milk"]
    assert set(milk) == {"name", "asset", "description", "category", "color", "position", "orientation", "size"}
    assert (milk["position"], milk["orientation"]) == ([0.4, 0, 0.095], [0, 0, 0, 1])
    assert told(thing("milk", "HOPE/Milk.urdf", 0.9, 0.095, reachable=False))["milk"]["reachable"] is False


def test_a_turned_container_tells_its_extents_and_the_room_in_it() -> None:
    box = told(thing("box", "container/open_box.urdf", 0.5, 0.045, yaw=math.pi / 2))["box"]
    assert box["size"] == pytest.approx([0.22, 0.3, 0.09], abs=0.002)
    assert box["own_size"] == [0.3, 0.22, 0.09]
    assert box["hollow"] and box["inner_size"] == pytest.approx([0.29, 0.21, 0.085], abs=0.003)
    fixtures = {item["name"]: item for item in fixture_assets_for_prompt(LIBRARY)}
    assert fixtures["container/container-template.urdf"]["inner_size"] == pytest.approx([0.19, 0.15, 0.055], abs=0.003)
    assert "inner_size" not in fixtures["zone/zone.urdf"] and fixtures["zone/zone.urdf"]["hollow"]
    lying: dict[str, Any] = {"orientation": quaternion_from_rpy(math.pi / 2, 0.0, 0.0)}
    assert "hollow" not in told(thing("mug", "mug/mug.urdf", 0.5, 0.04, **lying))["mug"]


def test_a_round_thing_is_as_wide_whichever_way_it_is_turned() -> None:
    bowl = told(thing("bowl", "bowl/bowl.urdf", 0.5, 0.03, yaw=0.7, round=True))["bowl"]
    assert bowl["size"] == [0.16, 0.16, 0.06]
    assert "own_size" not in bowl


def test_a_cylinder_is_as_wide_whichever_way_it_is_turned() -> None:
    tin = told(thing("tin", "HOPE/Tuna.urdf", 0.5, 0.016, yaw=math.pi / 4))["tin"]
    # the corners of its box would be 9.7 cm apart
    assert max(tin["size"][:2]) < 0.08


@pytest.mark.parametrize(("tilt", "leans"), [(0.0, None), (math.radians(20), 20), (math.pi / 2, None)])
def test_an_object_that_leans_has_its_angle(tilt: float, leans: int | None) -> None:
    milk = told(thing("milk", "HOPE/Milk.urdf", 0.5, 0.1, orientation=quaternion_from_rpy(tilt, 0.0, 0.3)))["milk"]
    assert milk.get("leans") == leans


def rebuilt(folder: Path, name: str, profile: list[tuple[float, float]], width: float) -> Library:
    """The library with a proxy: a convex ``profile`` of (x, z), m, extruded along y by ``width`` (m)."""
    corners = np.array([(x, y, z) for y in (-width / 2, width / 2) for x, z in profile])
    count = len(profile)
    ends = [(0, i, i + 1) for i in range(1, count - 1)]
    sides = [(i, (i + 1) % count, i + count) for i in range(count)]
    faces = np.array([*ends, *((a + count, c + count, b + count) for a, b, c in ends), *sides])
    mesh = ObjectMesh(corners, faces, np.zeros((len(corners), 2)), np.full((2, 2, 3), 200, np.uint8))
    write_proxy(folder, name, Proxy(mesh, (Hull(corners),), hollow=False, color=(0.8, 0.1, 0.1)), "a thing")
    return Library(*LIBRARY.roots, folder)


BOX = [(-0.03, 0.0), (0.03, 0.0), (0.03, 0.15), (-0.03, 0.15)]
BOOK = [(-0.1, 0.0), (0.1, 0.0), (0.1, 0.09), (-0.1, 0.01)]  # seen from above it fills the room beneath it
CARTON = [(-0.03, 0.0), (0.03, 0.0), (0.03, 0.15), (-0.03, 0.13)]


@pytest.mark.parametrize("yaw", [0.0, 0.6, math.pi / 4])
def test_a_level_top_is_even_however_the_box_is_turned(tmp_path: Path, yaw: float) -> None:
    library = rebuilt(tmp_path, "box", BOX, 0.2)
    box = told(thing("box", "proxy/box.urdf", 0.5, 0.075, yaw, library), library=library)["box"]
    assert "uneven_top" not in box and "leans" not in box


def test_a_book_that_leans_is_not_level_and_the_sloped_end_of_a_carton_does_not_lean(tmp_path: Path) -> None:
    library = rebuilt(tmp_path, "book", BOOK, 0.15)
    book = told(thing("book", "proxy/book.urdf", 0.5, 0.045, 0.5, library), library=library)["book"]
    assert book["uneven_top"] and book["leans"] == pytest.approx(math.degrees(math.atan(0.08 / 0.2)), abs=2)
    library = rebuilt(tmp_path, "carton", CARTON, 0.06)
    carton = told(thing("carton", "proxy/carton.urdf", 0.5, 0.075, 0.5, library), library=library)["carton"]
    assert carton["uneven_top"] and "leans" not in carton


def test_a_container_names_the_objects_that_stand_on_its_floor(tmp_path: Path) -> None:
    """Cookies go between the walls of a bowl, but are longer than its floor; the milk cannot be picked."""
    found = told(
        thing("bowl", "bowl/bowl.urdf", 0.6, 0.03, yaw=0.3),
        thing("block", "block/red_block.urdf", 0.4, 0.02, yaw=1.0),
        thing("cookies", "HOPE/Cookies.urdf", 0.4, 0.083),
        thing("milk", "HOPE/Milk.urdf", 0.4, 0.095, pick_trouble="it carries a block"),
        thing("mug", "mug/mug.urdf", 0.4, 0.05, yaw=0.4),
        thing("within", "block/blue_block.urdf", 0.6, 0.03),
        relations=({"kind": "in", "subject": "within", "reference": "bowl"},),
    )
    assert found["bowl"]["inner_size"] == pytest.approx([0.12, 0.12, 0.052], abs=0.002)
    assert found["bowl"]["fits"] == ["block", "mug"]
    assert found["mug"]["fits"] == ["block", "within"]


def test_an_object_that_is_held_on_its_support_does_not_float() -> None:
    found = told(
        thing("box", "HOPE/Cookies.urdf", 0.4, 0.083),
        thing("mug", "mug/mug.urdf", 0.4, 0.21, held=True),
        relations=({"kind": "on", "subject": "mug", "reference": "box"},),
    )
    assert (found["mug"]["on"], "floats" in found["mug"]) == ("box", False)
    assert found["mug"]["cannot_be_picked"] == "it does not stay on box when let go, and is held there"


def test_relations_are_told_of_their_subject() -> None:
    relations = (
        {"kind": "on", "subject": "block", "reference": "milk"},
        {"kind": "touching", "subject": "milk", "reference": "tuna"},
    )
    objects = (
        thing("milk", "HOPE/Milk.urdf", 0.4, 0.095),
        thing("block", "block/red_block.urdf", 0.4, 0.21),
        thing("tuna", "HOPE/Tuna.urdf", 0.47, 0.02),
    )
    found = told(*objects, relations=relations)
    assert found["block"]["on"] == "milk"
    assert found["milk"]["touching"] == ["tuna"] and found["tuna"]["touching"] == ["milk"]
    assert "touching" not in found["block"]


def test_a_thing_stands_where_it_came_to_rest_or_is_held() -> None:
    settled = ((0.41, 0.0, 0.02), FLAT)
    found = told(
        thing("fallen", "block/red_block.urdf", 0.4, 0.12, settled=settled),
        thing("high", "block/green_block.urdf", 0.61, 0.2, settled=((0.61, 0.0, 0.21), FLAT), held=True),
    )
    assert found["fallen"]["position"] == [0.41, 0, 0.02]
    assert "floats" not in found["fallen"]
    assert (found["high"]["position"], found["high"]["floats"]) == ([0.61, 0, 0.21], True)


def test_the_workspace_of_an_arm_that_reaches_less_far_is_smaller() -> None:
    scene = {"source": "s", "image": "i", "frame": FRAME, "objects": (), "relations": ()}
    assert scene_for_prompt(SceneDescription.model_validate(scene), LIBRARY, 0.6)["workspace"]["radius"] == 0.6
