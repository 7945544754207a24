import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.perception.shapes.mesh_simplification import simplify_closed_mesh
from grs_agents.perception.shapes.surface_nets import keep_large_pieces, mesh_zero_level


def grid_of(distance, cells=24, size=1.0):
    """Signed distances at the places of a cube of cells, its lowest corner and its step."""
    step = size / (cells - 1)
    places = np.indices((cells,) * 3).reshape(3, -1).T * step - size / 2
    return distance(places).reshape((cells,) * 3), np.full(3, -size / 2), step


def ball(center, radius):
    return lambda places: np.linalg.norm(places - center, axis=1) - radius


def test_surface_nets_find_a_ball():
    values, origin, step = grid_of(ball((0.02, 0, 0), 0.3))

    vertices, faces = mesh_zero_level(values, origin, step)

    solid = trimesh.Trimesh(vertices, faces, process=False)
    assert solid.is_volume
    assert solid.volume == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.05)
    assert np.abs(np.linalg.norm(vertices - (0.02, 0, 0), axis=1) - 0.3).max() < 0.2 * step


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), share=st.floats(0.1, 0.6))
def test_whatever_is_inside_each_edge_has_two_faces(seed, share):
    values = np.random.default_rng(seed).random((7, 7, 7)) - share

    vertices, faces = mesh_zero_level(values, np.zeros(3), 1.0)

    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 1000))
def test_simplified_mesh_is_closed_and_keeps_its_volume(seed):
    rng = np.random.default_rng(seed)
    balls = [ball(rng.uniform(-0.15, 0.15, 3), rng.uniform(0.12, 0.25)) for _ in range(3)]
    values, origin, step = grid_of(lambda places: np.min([one(places) for one in balls], axis=0))
    vertices, faces = mesh_zero_level(values, origin, step)

    few, simple = simplify_closed_mesh(vertices, faces, 400)

    before, after = (trimesh.Trimesh(*one, process=False) for one in ((vertices, faces), (few, simple)))
    assert len(simple) <= 400
    assert after.is_watertight
    assert after.volume == pytest.approx(before.volume, rel=0.02)


def test_small_pieces_and_cavities_go():
    def distance(places):
        hollow = np.maximum(ball((-0.1, 0, 0), 0.3)(places), -ball((-0.1, 0, 0), 0.12)(places))
        return np.minimum(hollow, ball((0.38, 0.38, 0.38), 0.08)(places))

    vertices, faces = keep_large_pieces(*mesh_zero_level(*grid_of(distance, 32)), 0.1)

    assert np.ptp(vertices, axis=0).max() < 0.62
    assert trimesh.Trimesh(vertices, faces, process=False).volume == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.05)
