"""Objects without an asset stand clear of others and stay where they were seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.proxies.proxy import Proxy, primitive_proxy
from grs_agents.perception.settling.proxy_placement import (
    PlacedProxy,
    extend_box_to_support,
    place_with_cleared_colliders,
    settle_with_stable_colliders,
)
from grs_agents.perception.shapes.colliders import Hull
from grs_agents.perception.shapes.types import ObjectMesh
from grs_agents.perception.types import UprightBox
from tests.perception.settling.photo import LIBRARY, MILK, photo_of, standing

RED = (0.8, 0.1, 0.1)
SIZE = (0.06, 0.06, 0.1)


def box_at(x: float, y: float, bottom: float = 0.0) -> UprightBox:
    return UprightBox(center=(x, y, bottom + SIZE[2] / 2), size=SIZE, yaw=0.3)


def unknown(name: str, box: UprightBox, proxy: Proxy | None = None) -> PlacedProxy:
    return PlacedProxy(name, "a thing", "box", box, proxy or primitive_proxy("box", SIZE, RED))


def pointed() -> Proxy:
    """A box to look at that touches with a cone upside down alone."""
    mesh = trimesh.creation.box(SIZE)
    vertices = np.asarray(mesh.vertices, np.float64) + np.array((0.0, 0.0, SIZE[2] / 2))
    plain = ObjectMesh(vertices, np.asarray(mesh.faces, np.int64), np.zeros((8, 2)), np.zeros((2, 2, 3), np.uint8))
    top = vertices[vertices[:, 2] > 0]
    return Proxy(plain, (Hull(np.concatenate([top, [(0.02, 0.0, 0.0)]])),), hollow=False, color=RED)


def test_neighbours_stand_clear_of_each_other_and_of_assets_without_moving(tmp_path: Path) -> None:
    things = [standing(MILK, 0.5, 0.0), unknown("one", box_at(0.5, 0.055)), unknown("two", box_at(0.545, 0.09))]
    photo = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    steady = settle_with_stable_colliders(things, tmp_path, lambda: LIBRARY.copy_with_overlay_root(tmp_path), *photo)
    assert steady.rest.found < 0.001
    assert max(end.drift for end in steady.rest.placed if end is not None) < 0.002
    assert {one.asset for one in steady.placed} == {MILK, "proxy/one.urdf", "proxy/two.urdf"}


def test_what_would_tip_over_stands_on_its_box_and_looks_as_before(tmp_path: Path) -> None:
    photo, reload = photo_of([standing(MILK, 0.5, 0.2)], LIBRARY), lambda: LIBRARY.copy_with_overlay_root(tmp_path)
    steady = settle_with_stable_colliders([unknown("one", box_at(0.5, 0.0), pointed())], tmp_path, reload, *photo)
    (end,) = steady.rest.placed
    assert end is not None and end.drift < 0.001 and not end.held
    assert matrix_from_quaternion(end.pose[1])[2, 2] == pytest.approx(1.0, abs=1e-4)
    model = reload().load_object_model("proxy/one.urdf")
    assert [one.kind for one in model.colliders] == ["box"] and model.visuals[0].kind == "mesh"


def test_what_was_cut_off_above_its_support_stands_on_it(tmp_path: Path) -> None:
    lower, upper = unknown("lower", box_at(0.5, 0.0)), box_at(0.5, 0.0, SIZE[2] + 0.006)
    reaching = extend_box_to_support(upper)
    assert reaching.size[2] == pytest.approx(SIZE[2] + 0.01)
    assert reaching.center[2] + reaching.size[2] / 2 == pytest.approx(upper.center[2] + SIZE[2] / 2)
    assert extend_box_to_support(box_at(0.5, 0.0)) == box_at(0.5, 0.0)
    stacked = PlacedProxy("upper", "a thing", "box", reaching, primitive_proxy("box", reaching.size, RED))
    placed = place_with_cleared_colliders([lower, stacked], tmp_path, LIBRARY)
    library = Library(tmp_path)
    heights = [library.load_object_model(one.asset).size[2] for one in placed]
    low, high = (one.pose[0][2] for one in placed)
    assert low + heights[0] / 2 == pytest.approx(high - heights[1] / 2, abs=5e-4)


def _blocks(kind: str) -> Proxy:
    """A box of SIZE, touching as a box, as a hull, or as two hulls of which one is wider and begins higher up."""
    plain = primitive_proxy("box", SIZE, RED)
    corners = np.asarray(trimesh.creation.box(SIZE).vertices) + np.array((0.0, 0.0, SIZE[2] / 2))
    wider = corners * (1.2, 1.2, 0.5) + (0.0, 0.0, SIZE[2] / 2)
    hulls = {"box": [], "hull": [Hull(corners)], "hulls": [Hull(corners), Hull(wider)]}[kind]
    return replace(plain, colliders=(*hulls,) or plain.colliders)


@pytest.mark.parametrize("kind", ["box", "hull", "hulls"])
def test_what_would_sink_reaches_down_to_what_carries_it(kind: str, tmp_path: Path) -> None:
    gap, upper = 0.008, box_at(0.5, 0.0, SIZE[2] + 0.008)
    things = [unknown("lower", box_at(0.5, 0.0)), unknown("upper", upper, _blocks(kind))]
    photo = photo_of([standing(MILK, 0.5, 0.2)], LIBRARY)
    steady = settle_with_stable_colliders(things, tmp_path, lambda: LIBRARY.copy_with_overlay_root(tmp_path), *photo)
    assert all(end is not None and end.drift < 0.001 and not end.held for end in steady.rest.placed)
    size = Library(tmp_path).load_object_model("proxy/upper.urdf").size
    assert size[2] == pytest.approx(SIZE[2] + gap, abs=5e-4)
    assert steady.placed[1].pose[0][2] + size[2] / 2 == pytest.approx(upper.center[2] + SIZE[2] / 2, abs=1e-6)
