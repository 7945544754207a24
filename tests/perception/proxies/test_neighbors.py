"""What is taken around a thing."""

import math

import numpy as np

from grs_agents.library import Library
from grs_agents.perception import EstimatedVolume, Surroundings, UprightBox

LIBRARY = Library()
TURNED = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
BOX = UprightBox(center=(0.5, 0.3, 0.05), size=(0.1, 0.1, 0.1), yaw=0.0)


def test_known_things_and_claims_take_their_space() -> None:
    claim = EstimatedVolume(BOX, "box", np.zeros((0, 3)))
    around = Surroundings([("HOPE/Spaghetti.urdf", ((0.5, 0.0, 0.0), TURNED))], [claim], LIBRARY)
    longest = int(np.argmax(LIBRARY.asset("HOPE/Spaghetti.urdf").size))
    along = np.zeros(3)
    along[{0: 1, 1: 0, 2: 2}[longest]] = LIBRARY.asset("HOPE/Spaghetti.urdf").size[longest] / 2 - 0.01
    points = np.array([np.array([0.5, 0.0, 0.0]) + along, [0.5, 0.3, 0.05], [0.5, 0.15, 0.0]])
    assert around.occupied_points_mask(points).tolist() == [True, True, False]
    assert not Surroundings([], [], LIBRARY).occupied_points_mask(points).any()
