"""Which points an asset's colliders hold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.perception.proxies.meshes import inside_colliders_mask

LIBRARY = Library()
COORDINATE = st.floats(-0.2, 0.2)


def solid(*shapes: Shape) -> ObjectModel:
    """An object of colliders alone."""
    return ObjectModel(visuals=(), colliders=shapes, mass=0.1, friction=0.5, bounds=((-1, -1, -1), (1, 1, 1)))


@given(COORDINATE, COORDINATE, COORDINATE)
def test_simple_solids_hold_what_is_in_them(x: float, y: float, z: float) -> None:
    point = np.array([[x, y, z]])
    ball = solid(Shape(kind="sphere", size=(0.1,)))
    can = solid(Shape(kind="cylinder", size=(0.05, 0.2)))
    box = solid(Shape(kind="box", size=(0.1, 0.2, 0.3), position=(0.05, 0.0, 0.0)))
    assert inside_colliders_mask(ball, LIBRARY, point)[0] == (np.linalg.norm(point) < 0.1)
    assert inside_colliders_mask(can, LIBRARY, point)[0] == (np.hypot(x, y) < 0.05 and abs(z) < 0.1)
    assert inside_colliders_mask(box, LIBRARY, point)[0] == (abs(x - 0.05) < 0.05 and abs(y) < 0.1 and abs(z) < 0.15)
    assert inside_colliders_mask(solid(), LIBRARY, point)[0] is np.False_


def test_a_turned_box_holds_its_corners_and_a_margin_more() -> None:
    box = solid(Shape(kind="box", size=(0.2, 0.02, 0.02), quaternion=(0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))))
    points = np.array([[0.0, 0.09, 0.0], [0.09, 0.0, 0.0], [0.013, 0.0, 0.0]])
    assert inside_colliders_mask(box, LIBRARY, points).tolist() == [True, False, False]
    assert inside_colliders_mask(box, LIBRARY, points, margin=0.005).tolist() == [True, False, True]


@pytest.mark.parametrize(("asset", "held"), [("container/open_box.urdf", False), ("HOPE/Milk.urdf", True)])
def test_a_container_is_empty_and_a_carton_is_full(asset: str, held: bool) -> None:
    model = LIBRARY.load_object_model(asset)
    middle = np.array(model.bounds).mean(axis=0)
    assert inside_colliders_mask(model, LIBRARY, middle[None])[0] == held
