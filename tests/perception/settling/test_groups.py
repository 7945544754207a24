"""A scene settles in groups, of which only those that are changed are simulated again."""

from dataclasses import replace
from itertools import pairwise

from grs_agents.perception.settling.groups import GroupSettler
from grs_agents.perception.settling.settling import PlacedObject
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, standing

SCENE = [
    standing(MILK, 0.5, 0.0),
    standing(BLOCK, 0.5, 0.0, above=0.2),
    standing(BLOCK, 0.4, 0.3),
    standing(BLOCK, 3, 0),
]


def moved(placed: PlacedObject, x: float) -> PlacedObject:
    """The object at another place along x, m."""
    (_, y, z), turn = placed.pose
    return replace(placed, pose=((x, y, z), turn))


def test_groups_that_are_not_changed_are_not_simulated_again_and_the_scene_is_that_from_scratch() -> None:
    settler = GroupSettler()
    before = settler.settle(SCENE, LIBRARY)
    assert before.placed[3] is None and before.still
    changed = [*SCENE[:2], moved(SCENE[2], 0.45), SCENE[3]]
    after = settler.settle(changed, LIBRARY)
    assert after.placed[0] is before.placed[0] and after.placed[1] is before.placed[1]
    assert after.placed[2] != before.placed[2]
    assert after == GroupSettler().settle(changed, LIBRARY)


def test_what_meets_another_thing_on_its_way_to_rest_is_settled_with_it() -> None:
    # the second block is pushed out of the first, into the place of the third
    row = [standing(BLOCK, 0.5, 0.0), standing(BLOCK, 0.5, 0.012), standing(BLOCK, 0.5, 0.0586)]
    rest = GroupSettler().settle(row, LIBRARY)
    assert rest.found > 0.01 and rest.penetration < 0.001
    places = sorted(end.pose[0][1] for end in rest.placed if end is not None)
    assert min(upper - lower for lower, upper in pairwise(places)) > 0.038


def test_without_a_thing_nothing_moves() -> None:
    assert GroupSettler().settle([], LIBRARY).largest_drift == 0
