"""The fixtures keep the published frames, since programs compute offsets from them."""

from itertools import product

import pytest

from grs_agents.library.library import Library
from grs_agents.library.shapes import shape_bounds

LIBRARY = Library()


def test_the_published_frames() -> None:
    stand = LIBRARY.load_object_model("hanoi/stand.urdf")
    assert stand.bounds[0] == pytest.approx((-0.06, -0.18, -0.005))
    assert stand.bounds[1] == pytest.approx((0.06, 0.18, 0.055))
    assert LIBRARY.load_object_model("stacking/stand.urdf").size == pytest.approx((0.05, 0.15, 0.005))
    assert LIBRARY.load_object_model("kitting/kit.urdf").size == pytest.approx((0.28, 0.2, 0.005))
    assert LIBRARY.load_object_model("pallet/pallet.urdf").size == pytest.approx((0.3, 0.25, 0.0375))
    assert LIBRARY.load_object_model("plane/plane.urdf").bounds[1][2] == 0


def test_the_ell_lies_in_its_fixture_with_room_to_spare() -> None:
    ell, fixture = LIBRARY.load_object_model("insertion/ell.urdf"), LIBRARY.load_object_model("insertion/fixture.urdf")
    assert ell.bounds[0] == pytest.approx((-0.015, -0.015, -0.02))
    assert ell.bounds[1] == pytest.approx((0.065, 0.065, 0.02))
    gaps: list[float] = []
    walls = [shape for shape in fixture.colliders if shape.size[2] == pytest.approx(0.04)]
    assert len(walls) == 6
    for leg, wall in product(ell.colliders, walls):
        (low, high), (start, end) = shape_bounds(leg), shape_bounds(wall)
        gaps.append(float(max((start - high)[:2].max(), (low - end)[:2].max())))
    assert min(gaps) > 0.007


def test_a_pallet_touches_as_one_solid_and_looks_like_boards() -> None:
    pallet = LIBRARY.load_object_model("pallet/pallet.urdf")
    assert len(pallet.colliders) == 1
    assert len(pallet.visuals) > 8


def test_a_plate_that_is_not_seen_holds_the_ell_up_in_its_fixture() -> None:
    fixture = LIBRARY.load_object_model("insertion/fixture.urdf")
    assert len(fixture.colliders) == len(fixture.visuals) + 1
    assert fixture.bounds[0][2] == pytest.approx(-0.02)
