"""Segments that lie on the surface of a known thing are pieces of it."""

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import asset_surface_at_pose
from grs_agents.perception.registration.unexplained_segments import match_pieces_to_objects

LIBRARY = Library()
SHELL = asset_surface_at_pose("HOPE/Milk.urdf", ((0.5, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)), LIBRARY)


def test_a_piece_of_a_known_thing_is_told_from_a_thing_beside_it() -> None:
    whole = SHELL.points
    piece = whole[whole[:, 2] > np.percentile(whole[:, 2], 80)] + 0.001
    beside = piece + np.array([0.0, 0.05, 0.0])
    assert match_pieces_to_objects([whole, piece, beside], [SHELL, None, None]) == {1: 0}


def test_the_whole_is_no_piece_of_itself_nor_of_a_smaller_segment() -> None:
    assert match_pieces_to_objects([SHELL.points[:500], SHELL.points], [SHELL, None]) == {}
