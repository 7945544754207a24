"""Lofts and tubes are closed, outward and of the size asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evals.synthesis.meshes import STRIP, loft, rectangle, superellipse, tube

LENGTHS = st.floats(0.01, 1.0)


@given(LENGTHS, LENGTHS, LENGTHS)
def test_a_box_has_its_volume_and_inertia(x: float, y: float, z: float) -> None:
    mesh = loft(rectangle(), [(x / 2, y / 2, 0.0), (x / 2, y / 2, z)]).centred()
    solid = mesh.solid()
    assert solid.is_watertight
    assert solid.volume == pytest.approx(x * y * z, rel=1e-6)
    assert mesh.inertia(2.0) == pytest.approx(
        [2 * (y * y + z * z) / 12, 2 * (x * x + z * z) / 12, 2 * (x * x + y * y) / 12], rel=1e-6
    )


@settings(deadline=None)
@given(st.lists(st.tuples(LENGTHS, LENGTHS), min_size=2, max_size=5), st.floats(2, 5))
def test_any_stack_of_ovals_is_closed(halves: list[tuple[float, float]], exponent: float) -> None:
    mesh = loft(superellipse(exponent), [(x, y, 0.1 * index) for index, (x, y) in enumerate(halves)])
    assert mesh.solid().is_watertight
    assert mesh.solid().volume > 0
    assert np.ptp(mesh.vertices, axis=0)[0] == pytest.approx(2 * max(x for x, _ in halves))
    assert mesh.uvs.min() >= 0
    assert mesh.uvs.max() <= 1


def test_the_label_starts_left_on_the_front_face() -> None:
    mesh = loft(rectangle(), [(1.0, 1.0, 0.0), (1.0, 1.0, 1.0)])
    front = mesh.vertices[mesh.faces[0]], mesh.uvs[mesh.face_uvs[0]]
    assert (front[0][:, 0] == 1).all()
    assert front[0][0] == pytest.approx((1, -1, 0))
    assert front[1][0] == pytest.approx((0, 1 - STRIP))


def test_a_tube_is_closed_and_outward() -> None:
    angles = np.linspace(0, np.pi, 9)
    path = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], 1)
    solid = tube(path, 0.1, (0, 1, 0)).solid()
    assert solid.is_watertight
    assert solid.volume == pytest.approx(np.pi * 0.1**2 * np.pi, rel=0.15)


def test_obj_names_texture_coordinates() -> None:
    lines = loft(rectangle(), [(1.0, 1.0, 0.0), (1.0, 1.0, 1.0)]).obj().splitlines()
    assert sum(line.startswith("v ") for line in lines) == 10
    assert all("/" in line for line in lines if line.startswith("f "))
