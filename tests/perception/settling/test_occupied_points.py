"""Space that is occupied by known objects."""

import math

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.settling.segment_reconciliation import occupied_points_mask
from grs_agents.perception.settling.settling import PlacedObject

LIBRARY = Library()
TURNED = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def test_known_things_take_their_space() -> None:
    around = [PlacedObject("HOPE/Spaghetti.urdf", ((0.5, 0.0, 0.0), TURNED))]
    longest = int(np.argmax(LIBRARY.asset("HOPE/Spaghetti.urdf").size))
    along = np.zeros(3)
    along[{0: 1, 1: 0, 2: 2}[longest]] = LIBRARY.asset("HOPE/Spaghetti.urdf").size[longest] / 2 - 0.01
    points = np.array([np.array([0.5, 0.0, 0.0]) + along, [0.5, 0.15, 0.0]])
    assert occupied_points_mask(points, around, LIBRARY).tolist() == [True, False]
    assert not occupied_points_mask(points, [], LIBRARY).any()
