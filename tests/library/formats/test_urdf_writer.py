"""What is written reads back."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.library.formats.urdf import format_urdf_text, read_urdf
from grs_agents.library.shapes import ObjectModel, Shape, matrix_from_quaternion, quaternion_from_rpy

SIZES = st.floats(0.001, 2.0)
VECTORS = st.tuples(*[st.floats(-1, 1)] * 3)


def shapes() -> st.SearchStrategy[Shape]:
    """Primitives anywhere."""
    box = st.tuples(SIZES, SIZES, SIZES).map(lambda size: ("box", size))
    cylinder = st.tuples(SIZES, SIZES).map(lambda size: ("cylinder", size))
    sphere = st.tuples(SIZES).map(lambda size: ("sphere", size))
    return st.builds(
        lambda solid, position, angles: Shape(
            kind=solid[0], size=solid[1], position=position, quaternion=quaternion_from_rpy(*angles)
        ),
        st.one_of(box, cylinder, sphere),
        VECTORS,
        VECTORS,
    )


def read_back(*solids: Shape) -> ObjectModel:
    """Write and read."""
    return read_urdf(format_urdf_text('a "name" & <more>', solids, solids, mass=0.5, friction=0.4), Path.cwd())


@given(st.lists(shapes(), min_size=1, max_size=4))
def test_primitives_survive(solids: list[Shape]) -> None:
    model = read_back(*solids)
    assert (model.mass, model.friction) == (0.5, 0.4)
    for before, after in zip(solids, model.colliders, strict=True):
        assert after.kind == before.kind
        assert after.size == pytest.approx(before.size, rel=1e-5)
        assert after.position == pytest.approx(before.position, abs=1e-5)
        assert np.allclose(
            matrix_from_quaternion(after.quaternion), matrix_from_quaternion(before.quaternion), atol=1e-4
        )


def test_files_are_named_relative_to_the_urdf() -> None:
    mesh = Shape(kind="mesh", size=(1, 1, 1), mesh="a/meshes/m.obj", texture="a/t.png", color=(1, 1, 1, 1))
    text = format_urdf_text("m", [mesh], [], mass=0.0, friction=0.5, folder="a")
    assert 'filename="meshes/m.obj"' in text
    assert 'filename="t.png"' in text
    assert "<inertial>" not in text
