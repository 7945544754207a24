"""An asset is looked up and aligned: its own points lie on it, its symmetries are found, a seen one is found again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import Tree
from grs_agents.perception.matching.asset_appearance import load_appearance

LIBRARY = Library()
ROUND, CUBE, BOX, MUG = "HOPE/Corn.urdf", "block/red_block.urdf", "HOPE/Popcorn.urdf", "mug/mug.urdf"


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_grid_finds_about_the_nearest_point(seed: int) -> None:
    asset = load_appearance(BOX, LIBRARY)
    places = np.random.default_rng(seed).uniform(-1, 1, (50, 3)) * (asset.half + 0.015)
    found = asset.points[asset.nearest_point_indices(places.astype(np.float32))]
    _, squares = Tree(asset.points.astype(np.float64)).find_nearest_points(places)
    # the nearest to the middle of a cell is at most the cell's diagonal farther
    assert np.all(np.linalg.norm(found - places, axis=1) <= np.sqrt(squares) + 1.8 * asset.cell)


def test_places_far_away_are_no_error() -> None:
    asset = load_appearance(BOX, LIBRARY)
    found = asset.nearest_point_indices(np.array([[10.0, -10.0, 3.0], [-9.0, 0.0, 0.0]], np.float32))
    assert ((found >= 0) & (found < len(asset.points))).all()


@pytest.mark.parametrize(("name", "symmetries", "rotations"), [(CUBE, 24, 1), (BOX, 4, 6), (MUG, 1, 24)])
def test_turns_that_leave_a_shape_as_it_is_are_not_tried_twice(name: str, symmetries: int, rotations: int) -> None:
    asset = load_appearance(name, LIBRARY)
    assert (len(asset.symmetries), len(asset.rotations)) == (symmetries, rotations)
    assert np.allclose(asset.symmetries[0], np.eye(3))
    assert np.allclose(np.linalg.det(asset.symmetries), 1, atol=1e-5)


def test_what_is_round_is_turned_finely() -> None:
    asset = load_appearance("HOPE/Yogurt.urdf", LIBRARY)
    assert len(asset.symmetries) in (24, 48)
    assert len(asset.rotations) in (3, 6)
