"""What the asset of a segment does not explain is another thing."""

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import asset_surface_at_pose
from grs_agents.perception.registration.unexplained_segments import (
    ResidualCandidates,
    find_residual_candidates,
    label_residual_pixels,
)
from grs_agents.perception.settling.settling import PlacedObject
from tests.perception.settling.photo import photo_of

LIBRARY = Library()
MILK = PlacedObject("HOPE/Milk.urdf", ((0.55, 0.0, 0.096), (0.0, 0.0, 0.0, 1.0)))
BLOCK = PlacedObject("block/red_block.urdf", ((0.47, 0.03, 0.02), (0.0, 0.0, 0.0, 1.0)))
BOTH, TABLE, MASK = photo_of([MILK, BLOCK], LIBRARY)
BLOCK_ALONE = photo_of([BLOCK], LIBRARY)[2]


def test_what_stands_against_a_known_thing_is_found_once_that_stands() -> None:
    shell = asset_surface_at_pose(MILK.asset, MILK.pose, LIBRARY)
    (found,) = find_residual_candidates([MASK], [shell], BOTH, TABLE, 7).candidates
    assert found.id == 7
    assert (found.mask & BLOCK_ALONE).sum() > 0.7 * BLOCK_ALONE.sum()
    assert (found.mask & ~BLOCK_ALONE).sum() < 0.1 * BLOCK_ALONE.sum()


def test_an_asset_that_stands_wrongly_tells_nothing() -> None:
    wrong = asset_surface_at_pose(MILK.asset, ((0.55, 0.0, 0.15), (0.0, 0.0, 0.0, 1.0)), LIBRARY)
    assert not label_residual_pixels([MASK], [wrong], BOTH, TABLE)[0].any()
    assert find_residual_candidates([MASK], [None], BOTH, TABLE, 1) == ResidualCandidates()


def test_a_segment_that_joins_a_known_thing_and_another_is_divided() -> None:
    """Half of the milk is one segment, that is known; the other half and the block are the other, that is not."""
    columns = np.nonzero(MASK & ~BLOCK_ALONE)[1]
    first = MASK & ~BLOCK_ALONE & (np.arange(MASK.shape[1]) < np.median(columns))
    later = find_residual_candidates(
        [first, MASK & ~first], [asset_surface_at_pose(MILK.asset, MILK.pose, LIBRARY), None], BOTH, TABLE, 7
    )
    assert later.divided == (1,)
    (found,) = later.candidates
    assert (found.mask & BLOCK_ALONE).sum() > 0.7 * BLOCK_ALONE.sum()
    assert (found.mask & ~BLOCK_ALONE).sum() < 0.1 * BLOCK_ALONE.sum()


def test_a_thing_that_touches_a_known_one_is_not_divided() -> None:
    masks = [MASK & ~BLOCK_ALONE, BLOCK_ALONE & MASK]
    assert (
        label_residual_pixels(masks, [asset_surface_at_pose(MILK.asset, MILK.pose, LIBRARY), None], BOTH, TABLE)[1]
        == ()
    )


def test_a_thing_that_its_asset_explains_leaves_nothing() -> None:
    alone, table, mask = photo_of([MILK], LIBRARY)
    assert not np.any(
        label_residual_pixels([mask], [asset_surface_at_pose(MILK.asset, MILK.pose, LIBRARY)], alone, table)[0]
    )
