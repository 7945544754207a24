"""Pictures of assets without GL."""

import numpy as np
import pytest

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.library.asset_rendering import (
    AssetView,
    random_view_directions,
    render_asset_views,
    ring_view_directions,
)
from grs_agents.library.library import Library


@pytest.fixture(scope="module")
def library() -> Library:
    return Library()


def one(library: Library, name: str, direction: Vec3, size: int = 96) -> AssetView:
    return render_asset_views(library, name, [direction], size=size)[0]


def extents(view: AssetView) -> tuple[float, float]:
    """Width and height (m) of what is seen, taken at the distance of the object's centre."""
    rows, columns = np.nonzero(view.rgba[:, :, 3] > 127)
    scale = view.distance / view.focal
    return (np.ptp(columns) + 1) * scale, (np.ptp(rows) + 1) * scale


@pytest.mark.parametrize("name", ["HOPE/Milk.urdf", "HOPE/Ketchup.urdf", "bowl/bowl.urdf", "cylinder/cylinder.urdf"])
def test_a_view_shows_the_whole_asset_at_its_metric_size(library: Library, name: str) -> None:
    x, y, z = library.load_object_model(name).size
    for direction, (width, height) in (((1, 0, 0), (y, z)), ((0, 1, 0), (x, z)), ((0, 0, 1), (y, x))):
        seen = extents(one(library, name, direction))
        assert np.allclose(seen, (width, height), rtol=0.25, atol=0.004)


def test_depth_is_metres_along_the_optical_axis(library: Library) -> None:
    view = one(library, "HOPE/Milk.urdf", (1, 0, 0))
    middle = view.depth.shape[0] // 2
    assert view.depth[middle, middle] == pytest.approx(
        view.distance - library.load_object_model("HOPE/Milk.urdf").size[0] / 2, abs=1e-3
    )
    assert ((view.depth > 0) == (view.rgba[:, :, 3] > 0)).all()


def test_textures_are_upright_and_not_mirrored(library: Library) -> None:
    view = one(library, "HOPE/Milk.urdf", (1, 0, 0))
    rows = np.flatnonzero((view.rgba[:, :, 3] > 200).any(axis=1))
    low, high = view.rgba[rows[-4], 48, :3].astype(int), view.rgba[rows[20], 48, :3].astype(int)
    assert low[2] > low[0] + 60  # the blue foot
    assert abs(high[2] - high[0]) < 30  # the white gable


def test_the_same_view_twice_is_the_same_picture(library: Library) -> None:
    first, second = (
        one(library, "mug/mug.urdf" if "mug/mug.urdf" in library else "bowl/bowl.urdf", (1, 1, 1)) for _ in range(2)
    )
    assert (first.rgba == second.rgba).all() and (first.depth == second.depth).all()


def test_directions_are_unit_vectors_above_the_table() -> None:
    for directions in (random_view_directions(20, np.random.default_rng(3)), ring_view_directions(8)):
        assert np.allclose(np.linalg.norm(directions, axis=1), 1)
        assert (np.asarray(directions)[:, 2] > 0).all()


@pytest.mark.parametrize(
    ("direction", "size"), [((0, 0, 0), 96), ((np.nan, 0, 1), 96), ((1, 0, 0), 2), ((1, 0, 0), 9999)]
)
def test_what_cannot_be_drawn_is_refused(library: Library, direction: Vec3, size: int) -> None:
    with pytest.raises(InputError):
        one(library, "HOPE/Milk.urdf", direction, size)
