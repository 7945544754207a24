"""What stands for the segments of a photo agrees with what is known."""

import numpy as np

from grs_agents.library import Library
from grs_agents.perception import UprightBox
from grs_agents.perception.settling import PlacedObject, Segment, match_fallen_to_support, reconcile_segments
from tests.perception.settling.photo import photo_of

LIBRARY = Library()
MILK = PlacedObject("HOPE/Milk.urdf", ((0.5, 0.0, 0.096), (0.0, 0.0, 0.0, 1.0)))
BLOCK = PlacedObject("block/red_block.urdf", ((0.38, 0.05, 0.02), (0.0, 0.0, 0.0, 1.0)))


def test_a_piece_is_dropped_and_a_fat_box_gives_way() -> None:
    frame, table, both = photo_of([MILK, BLOCK], LIBRARY)
    _, _, milk = photo_of([MILK], LIBRARY)
    milk &= frame.depth == photo_of([MILK], LIBRARY)[0].depth
    upper = milk & (np.arange(milk.shape[0])[:, None] < np.median(np.nonzero(milk)[0]) - 10)
    box = UprightBox(center=(0.42, 0.05, 0.02), size=(0.12, 0.04, 0.04), yaw=0.0)  # reaches into the milk
    segments = [
        Segment(milk & ~upper, box, "box", MILK),
        Segment(upper, box, "box", None),
        Segment(both & ~milk, box, "box", None),
    ]
    agreed = reconcile_segments(segments, frame, table, LIBRARY)
    assert agreed.pieces == {1: 0}
    assert set(agreed.claims) == {2}
    assert agreed.claims[2].box.size[0] < 0.11


def test_a_guess_that_a_known_thing_fills_is_a_piece_of_it() -> None:
    frame, table, mask = photo_of([MILK, BLOCK], LIBRARY)
    left = mask & (np.arange(mask.shape[1]) < np.median(np.nonzero(mask)[1]))
    inner = UprightBox(center=MILK.pose[0], size=(0.04, 0.04, 0.15), yaw=0.0)
    block = UprightBox(center=BLOCK.pose[0], size=(0.04, 0.04, 0.04), yaw=0.0)
    segments = [
        Segment(mask & ~left, inner, "box", MILK),
        Segment(left, inner, "box", None),
        Segment(left, block, "box", None),
    ]
    agreed = reconcile_segments(segments, frame, table, LIBRARY)
    assert agreed.pieces == {1: 0} and set(agreed.claims) == {2}
    around = agreed.surroundings_of_segment(2)
    assert around.occupied_points_mask(np.array([MILK.pose[0], BLOCK.pose[0]])).tolist() == [True, False]


def test_what_stays_inside_a_solid_thing_is_a_piece_of_it_but_not_in_a_hollow_one() -> None:
    frame, table, mask = photo_of([MILK, BLOCK], LIBRARY)
    left = mask & (np.arange(mask.shape[1]) < np.median(np.nonzero(mask)[1]))
    around = UprightBox(center=(0.45, 0.02, 0.1), size=(0.25, 0.2, 0.21), yaw=0.0)
    inner = UprightBox(center=(0.45, 0.02, 0.1), size=(0.2, 0.15, 0.2), yaw=0.0)
    for hollow, pieces in ((False, {1: 0}), (True, {})):
        segments = [Segment(mask & ~left, around, "box", None, hollow), Segment(left, inner, "box", None)]
        agreed = reconcile_segments(segments, frame, table, LIBRARY)
        assert agreed.pieces == pieces
        assert set(agreed.claims) == {0, 1} - set(pieces)


def test_what_falls_is_a_piece_of_what_it_touches() -> None:
    """A carton in two pieces and a block beside it, of which nothing is known."""
    frame, table, mask = photo_of([MILK, BLOCK], LIBRARY)
    block = photo_of([BLOCK], LIBRARY)[2] & mask
    upper = mask & ~block & (np.arange(mask.shape[0])[:, None] < np.median(np.nonzero(mask)[0]) - 10)
    x, y, _ = MILK.pose[0]
    low = UprightBox(center=(x, y, 0.06), size=(0.07, 0.07, 0.12), yaw=0.0)
    high = UprightBox(center=(x, y, 0.156), size=(0.07, 0.07, 0.072), yaw=0.0)
    stone = UprightBox(center=BLOCK.pose[0], size=(0.04, 0.04, 0.04), yaw=0.0)
    segments = [
        Segment(mask & ~upper & ~block, low, "box", None),
        Segment(upper, high, "box", None),
        Segment(block, stone, "box", None),
    ]
    agreed = reconcile_segments(segments, frame, table, LIBRARY)
    assert not agreed.pieces and not match_fallen_to_support(set(), agreed)
    assert match_fallen_to_support({1}, agreed) == {1: 0}
    assert match_fallen_to_support({7}, agreed) == {}
    whole = reconcile_segments(segments, frame, table, LIBRARY, {1: 0})
    assert whole.pieces == {1: 0} and set(whole.claims) == {0, 2}
    assert (whole.masks[0] == (mask & ~block)).all()
    assert whole.claims[0].box.size[2] > agreed.claims[0].box.size[2] + 0.03


def test_what_lies_in_a_known_box_stands_on_its_floor() -> None:
    """The box measured of a block there reaches down to the table."""
    container = PlacedObject("container/open_box.urdf", ((0.5, 0.0, 0.045), (0.0, 0.0, 0.0, 1.0)))
    block = PlacedObject(BLOCK.asset, ((0.5, 0.0, 0.03), (0.0, 0.0, 0.0, 1.0)))
    frame, table, mask = photo_of([container, block], LIBRARY)
    alone = photo_of([container], LIBRARY)[0]
    inner = mask & (np.abs(frame.depth - alone.depth) > 1e-4)
    down = UprightBox(center=(0.5, 0.0, 0.025), size=(0.04, 0.04, 0.05), yaw=0.0)
    around = UprightBox(center=container.pose[0], size=(0.3, 0.22, 0.09), yaw=0.0)
    segments = [
        Segment(mask & ~inner, around, "box", container, hollow=True),
        Segment(inner, down, "box", None),
    ]
    low = reconcile_segments(segments, frame, table, LIBRARY).claims[1].box
    assert 0.003 < low.center[2] - low.size[2] / 2 < 0.015
    assert abs(low.center[2] + low.size[2] / 2 - 0.05) < 1e-6, "its top stays"
    free = reconcile_segments([segments[1]], frame, table, LIBRARY).claims[0].box
    assert free == down, "on the table it stays"
