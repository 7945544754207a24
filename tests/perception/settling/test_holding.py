"""What would fall stays where the photo shows it."""

from grs_agents.perception.settling.settling import PlacedObject, settle_and_measure_fidelity, settle_objects
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing


def test_what_the_photo_shows_in_the_air_is_held_there() -> None:
    hanging = standing(BLOCK, 0.5, 0.0, above=0.1)
    frame, table, mask = photo_of([hanging], LIBRARY)
    rest, report = settle_and_measure_fidelity([hanging], LIBRARY, frame, table, mask)
    assert report.held == 1 and report.drift < 0.002 and report.fidelity is not None and report.fidelity > 0.9
    assert rest.placed[0] is not None and rest.placed[0].held


def test_what_stands_on_something_that_was_found_is_not_held() -> None:
    both = [standing(BLOCK, 0.5, 0.0), standing(BLOCK, 0.5, 0.0, above=0.04)]
    assert not any(placed.held for placed in settle_objects(both, LIBRARY).placed if placed is not None)


def test_only_the_lowest_of_a_pile_is_held() -> None:
    pile = [standing(BLOCK, 0.5, 0.0, above=height) for height in (0.04, 0.08)]
    rest = settle_objects(pile, LIBRARY)
    assert [placed is not None and placed.held for placed in rest.placed] == [True, False]
    assert all(placed is not None and placed.drift < 0.003 for placed in rest.placed)


def test_a_guess_gives_way_before_what_is_known() -> None:
    milk, block = standing(MILK, 0.5, 0.0), standing(BLOCK, 0.5, 0.046)
    guess = PlacedObject(milk.asset, milk.pose, guessed=True)
    moved = [placed.drift for placed in settle_objects([guess, block], LIBRARY).placed if placed is not None]
    assert moved[0] > 0.005 > moved[1]
