"""Marks are thin, colourable and touch nothing."""

import pytest

from evals.synthesis.built_asset import BuiltAsset
from grs_agents.library.library import Library
from scripts.assets.marks import build_marks

LIBRARY = Library()


@pytest.mark.parametrize("one", build_marks(), ids=lambda one: one.asset.name)
def test_a_mark_takes_a_size_and_a_colour(one: BuiltAsset) -> None:
    assert "<collision>" not in one.urdf
    model = LIBRARY.load_filled_template(one.asset.name, {"DIM": (0.3, 0.2, 0.0), "COLOR": (1, 0, 0)})
    assert {shape.color for shape in model.visuals} == {(1, 0, 0, 1)}
    assert model.size[2] <= 0.002
    assert model.size[0] <= 0.32


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_rectangle_has_as_many_sides_as_its_name_says(count: int) -> None:
    assert len(LIBRARY.load_object_model(f"rectangle/rectangle-template-sides-{count}.urdf").visuals) == count


def test_a_square_is_open_towards_y_or_closed() -> None:
    assert len(LIBRARY.load_object_model("square/square-template.urdf").visuals) == 3
    closed = LIBRARY.load_object_model("square/square-template-allsides-blue.urdf")
    assert len(closed.visuals) == 4
    assert closed.visuals[0].color == (0.16, 0.36, 0.8, 1)
