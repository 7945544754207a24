"""The described scene comes to rest in MuJoCo."""

from dataclasses import replace

import numpy as np

from grs_agents.perception.settling.settling import measure_depth_fidelity, settle_and_measure_fidelity, settle_objects
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing


def test_what_stands_stays() -> None:
    rest = settle_objects([standing(MILK, 0.5, 0.0), standing(BLOCK, 0.4, 0.2)], LIBRARY)
    assert rest.still and rest.penetration < 0.001
    assert all(placed is not None and placed.drift < 0.002 and not placed.held for placed in rest.placed)


def test_what_overlaps_is_eased_apart_and_not_thrown() -> None:
    rest = settle_objects([standing(BLOCK, 0.5, 0.0), standing(BLOCK, 0.5, 0.025)], LIBRARY)
    assert rest.found > 0.005
    assert rest.penetration < 0.001
    assert all(placed is not None and placed.drift < 0.03 for placed in rest.placed)


def test_what_is_off_the_table_has_no_twin() -> None:
    far, near = settle_objects([standing(BLOCK, 3.0, 0.0), standing(BLOCK, 0.5, 0.0)], LIBRARY).placed
    assert far is None and near is not None


def test_a_true_twin_shows_what_the_photo_shows() -> None:
    things = [standing(MILK, 0.5, 0.0), standing(BLOCK, 0.4, 0.1)]
    frame, table, mask = photo_of(things, LIBRARY)
    _, report = settle_and_measure_fidelity(things, LIBRARY, frame, table, mask)
    assert report.fidelity is not None and report.fidelity > 0.97 and report.drift < 0.002
    assert (measure_depth_fidelity(things[1:], LIBRARY, frame, table, mask) or 0.0) < 0.3
    assert measure_depth_fidelity(things, LIBRARY, frame, table, np.zeros_like(mask)) is None


def test_what_is_inside_another_thing_is_taken_out_of_it_and_the_others_stay() -> None:
    milk = standing(MILK, 0.5, 0.0)
    rest = settle_objects([milk, standing(BLOCK, 0.5, 0.01), standing(BLOCK, 0.3, 0.2)], LIBRARY)
    assert rest.found > 0.01 and rest.penetration < 0.001 and rest.still
    drifts = [placed.drift for placed in rest.placed if placed is not None]
    assert sorted(drifts)[1] < 0.003, "one thing is moved"


def test_what_is_stuck_in_another_thing_is_moved_as_far_as_it_takes() -> None:
    box = "container/open_box.urdf"
    rest = settle_objects([standing(box, 0.5, 0.0), standing(box, 0.53, 0.02)], LIBRARY)
    assert rest.found > 0.02
    assert rest.still and rest.penetration < 0.001


def test_what_is_guessed_gives_way_but_not_by_far() -> None:
    """A block at the edge of a carton's top is lifted a little, sooner than that a guessed carton is moved aside."""
    carton = replace(standing(MILK, 0.5, 0.0), guessed=True)
    (low, _, bottom), (high, _, top) = LIBRARY.load_object_model(MILK).bounds
    block = standing(BLOCK, 0.5 + (high - low) / 2 + 0.007, 0.0, above=top - bottom - 0.008)
    placed, on_top = settle_objects([carton, block], LIBRARY).placed
    assert placed is not None and placed.drift < 0.005
    assert on_top is not None and on_top.drift < 0.012
    shallow = standing(BLOCK, 0.5 + (high - low) / 2 + 0.014, 0.0)
    placed, beside = settle_objects([carton, shallow], LIBRARY).placed
    assert placed is not None and 0.004 < placed.drift < 0.012
    assert beside is not None and beside.drift < 0.003


def test_two_guesses_share_a_long_way() -> None:
    first, second = (replace(standing(MILK, 0.5, y), guessed=True) for y in (0.0, 0.05))
    drifts = [placed.drift for placed in settle_objects([first, second], LIBRARY).placed if placed is not None]
    assert len(drifts) == 2 and min(drifts) > 0.007 and max(drifts) < 0.015


def test_what_is_in_the_table_is_lifted_with_what_is_on_it() -> None:
    """A carton that was registered too low, with a block in its top: neither is moved aside."""
    (_, _, bottom), (_, _, top) = LIBRARY.load_object_model(MILK).bounds
    carton = standing(MILK, 0.5, 0.0, above=-0.005)
    block = standing(BLOCK, 0.5, 0.0, above=top - bottom - 0.009)
    rest = settle_objects([carton, block], LIBRARY)
    assert rest.penetration < 0.001 and not any(placed is None or placed.held for placed in rest.placed)
    for thing, placed in zip((carton, block), rest.placed, strict=True):
        assert placed is not None and np.hypot(*np.subtract(placed.pose[0], thing.pose[0])[:2]) < 0.001
        assert 0.003 < placed.drift < 0.01
