"""Colliders that reach into each other are cut back to planes between them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.geometry.transforms import pose_matrix, rotation_about_z
from grs_agents.library.shapes import Shape
from grs_agents.perception.settling.proxy_placement import PlacedColliders, Rank, clear_colliders, colliders_of_asset
from grs_agents.perception.shapes.colliders import Collider, Hull
from grs_agents.perception.types import Array
from tests.perception.settling.photo import LIBRARY, MILK

BLOCK = Shape(kind="box", size=(0.1, 0.1, 0.2), position=(0.0, 0.0, 0.1))
CAN = Shape(kind="cylinder", size=(0.04, 0.1), position=(0.0, 0.0, 0.05))


def at(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Array:
    return pose_matrix(rotation_about_z(yaw), np.array((x, y, z)))


def corners(colliders: tuple[Collider, ...], pose: Array) -> Array:
    """(N, 3) of hulls, robot frame."""
    assert all(isinstance(one, Hull) for one in colliders)
    return np.concatenate([one.corners for one in colliders if isinstance(one, Hull)]) @ pose[:3, :3].T + pose[:3, 3]


def test_two_that_overlap_are_cut_half_way_and_others_stay_as_they_are() -> None:
    poses = [at(0.0, 0.0), at(0.08, 0.0), at(0.5, 0.0)]
    first, second, apart = clear_colliders(
        [PlacedColliders([shape], pose) for shape, pose in zip((BLOCK, CAN, CAN), poses, strict=True)]
    )
    assert corners(first, poses[0])[:, 0].max() == pytest.approx(0.045, abs=1e-4)
    assert corners(second, poses[1])[:, 0].min() == pytest.approx(0.045, abs=1e-4)
    assert apart == (CAN,)


@settings(max_examples=20, deadline=None)
@given(st.floats(-0.06, 0.06), st.floats(0.03, 0.06), st.floats(-0.5, 0.5))
def test_once_cut_nothing_overlaps_and_each_can_be_lifted_out(x: float, y: float, yaw: float) -> None:
    poses = [at(0.0, 0.0), at(x, y + 0.02, 0.0, yaw)]
    cleared = clear_colliders([PlacedColliders([BLOCK], pose) for pose in poses])
    for lift in (0.0, 0.05):
        lifted = [PlacedColliders(cleared[0], at(0.0, 0.0, lift)), PlacedColliders(cleared[1], poses[1])]
        again = clear_colliders(lifted)
        for before, after in zip(cleared, again, strict=True):
            assert len(before) == len(after)
            changed = [
                np.ptp(one.corners, axis=0).prod() / np.ptp(other.corners, axis=0).prod()
                for one, other in zip(after, before, strict=True)
                if isinstance(one, Hull) and isinstance(other, Hull)
            ]
            assert all(share > 0.95 for share in changed)


@pytest.mark.parametrize("rank", [Rank.HOLLOW, Rank.ASSET])
def test_what_is_not_to_be_cut_stays_whole(rank: Rank) -> None:
    poses = [at(0.0, 0.0), at(0.08, 0.0)]
    whole, cut = clear_colliders([PlacedColliders([BLOCK], poses[0], rank), PlacedColliders([CAN], poses[1])])
    assert whole == (BLOCK,)
    assert corners(cut, poses[1])[:, 0].min() == pytest.approx(0.05, abs=2e-4)


def test_what_would_lose_too_much_is_not_cut() -> None:
    small = Shape(kind="box", size=(0.04, 0.04, 0.04), position=(0.0, 0.0, 0.02))
    _, kept = clear_colliders(
        [PlacedColliders([BLOCK], at(0.0, 0.0), Rank.ASSET), PlacedColliders([small], at(0.04, 0.0))]
    )
    assert kept == (small,)


def test_to_what_would_lose_too_much_its_neighbour_gives_way_alone() -> None:
    small, poses = Shape(kind="box", size=(0.04, 0.04, 0.2), position=(0.0, 0.0, 0.1)), [at(0.0, 0.0), at(0.02, 0.0)]
    gives_way, kept = clear_colliders([PlacedColliders([BLOCK], poses[0]), PlacedColliders([small], poses[1])])
    assert kept == (small,)
    assert corners(gives_way, poses[0])[:, 0].max() == pytest.approx(0.0, abs=2e-4)


def test_what_stands_beside_a_thin_floor_keeps_its_underside_and_what_lies_on_it_does_not() -> None:
    floor = Shape(kind="box", size=(0.2, 0.2, 0.004), position=(0.0, 0.0, 0.002))
    beside, on = at(0.145, 0.0), at(0.02, 0.0)
    for pose, lowest in ((beside, 0.0), (on, 0.004)):
        _, cut = clear_colliders([PlacedColliders([floor], at(0.0, 0.0), Rank.HOLLOW), PlacedColliders([BLOCK], pose)])
        assert corners(cut, pose)[:, 2].min() == pytest.approx(lowest, abs=2e-4)
    _, cut = clear_colliders([PlacedColliders([floor], at(0.0, 0.0), Rank.HOLLOW), PlacedColliders([BLOCK], beside)])
    assert corners(cut, beside)[:, 0].min() == pytest.approx(0.1, abs=2e-4)


def test_what_lies_on_something_nearly_level_is_cut_level() -> None:
    sides = [(x, y) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    below = Hull(np.array([(x, y, z) for x, y in sides for z in (0.0, 0.06 + 0.08 * x)]))
    above = Hull(np.array([(x, y, z) for x, y in sides for z in (0.05 + 0.08 * x, 0.2)]))
    _, cut = clear_colliders([PlacedColliders([one], at(0.0, 0.0)) for one in (below, above)])
    underside = np.sort(corners(cut, at(0.0, 0.0))[:, 2])[:4]
    assert np.ptp(underside) < 4e-4


def test_an_asset_s_colliders_are_where_its_model_has_them() -> None:
    model = LIBRARY.load_object_model(MILK)
    ends = [
        end
        for one in colliders_of_asset(MILK, LIBRARY)
        for end in (
            (one.corners.min(axis=0), one.corners.max(axis=0))
            if isinstance(one, Hull)
            else (np.subtract(one.position, np.array(one.size) / 2), np.add(one.position, np.array(one.size) / 2))
        )
    ]
    assert np.min(ends, axis=0) == pytest.approx(np.array(model.bounds[0]), abs=1e-6)
    assert np.max(ends, axis=0) == pytest.approx(np.array(model.bounds[1]), abs=1e-6)
