"""Of two assets that were registered into each other, the one that was registered wrongly is registered again."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.settling.collision_repair import CollisionRepairs, repair_collisions
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame, UprightBox
from tests.perception.settling.photo import LIBRARY, MILK, photo_of, standing

SOUP = "HOPE/AlphabetSoup.urdf"
FRONT, BEHIND = standing(SOUP, 0.42, 0.0), standing(MILK, 0.5, 0.02)


def box_of(thing: PlacedObject) -> UprightBox:
    """The box around an upright asset."""
    low, high = LIBRARY.load_object_model(thing.asset).bounds
    x, y, z = (float(value) for value in np.subtract(high, low))
    return UprightBox(center=thing.pose[0], size=(x, y, z), yaw=0.0)


def moved(thing: PlacedObject, x: float, y: float) -> PlacedObject:
    """It, so far along x and y, m."""
    return replace(thing, pose=((thing.pose[0][0] + x, thing.pose[0][1] + y, thing.pose[0][2]), thing.pose[1]))


@pytest.fixture(scope="module")
def photo() -> tuple[RGBDFrame, TableFrame, Mask, Mask]:
    """A can before a carton, and the pixels of each."""
    frame, table, both = photo_of([FRONT, BEHIND], LIBRARY)
    alone, _, can = photo_of([FRONT], LIBRARY)
    can &= alone.depth == frame.depth
    return frame, table, can, both & ~can


def test_what_was_laid_into_another_thing_is_laid_beside_it(photo: tuple[RGBDFrame, TableFrame, Mask, Mask]) -> None:
    frame, table, can, carton = photo
    wrong = moved(BEHIND, -0.05, -0.01)
    boxes = [box_of(FRONT), box_of(wrong)]
    found = repair_collisions([FRONT, wrong], boxes, [can, carton], frame, table, LIBRARY)
    assert set(found.moved) == {1} and not found.wrong
    assert np.linalg.norm(np.subtract(found.moved[1].position, BEHIND.pose[0])) < 0.01


def test_what_stands_side_by_side_stays(photo: tuple[RGBDFrame, TableFrame, Mask, Mask]) -> None:
    frame, table, can, carton = photo
    boxes = [box_of(FRONT), box_of(BEHIND)]
    assert repair_collisions([FRONT, BEHIND], boxes, [can, carton], frame, table, LIBRARY) == CollisionRepairs()
    assert repair_collisions([], [], [], frame, table, LIBRARY) == CollisionRepairs()


def test_of_two_in_one_place_the_one_that_fits_worse_is_wrong(photo: tuple[RGBDFrame, TableFrame, Mask, Mask]) -> None:
    frame, table, can, _ = photo
    twice, boxes = [FRONT, moved(FRONT, 0.01, 0.0)], [box_of(FRONT)] * 2
    found = repair_collisions(twice, boxes, [can, can], frame, table, LIBRARY)
    assert found == CollisionRepairs(wrong=frozenset({1}))
