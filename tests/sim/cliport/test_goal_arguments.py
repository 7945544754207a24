from typing import Any

import numpy as np
import pytest

from grs_agents.sim import SimulationError, Zone
from grs_agents.sim.cliport.goal_arguments import convert_to_goal, make_goal

POSE = ((0.5, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0))


def goal(**changes):
    given: dict[str, Any] = {
        "objs": [1, 2],
        "matches": np.ones((2, 1)),
        "targ_poses": [POSE],
        "replace": True,
        "rotations": True,
        "metric": "pose",
        "params": None,
        "step_max_reward": 1.0,
        "symmetries": None,
    } | changes
    return make_goal(**given)[0]


def test_cliports_tuple_of_eight_becomes_a_goal() -> None:
    made = convert_to_goal(([1, 2], np.ones((2, 1)), [POSE], True, True, "pose", None, 1.0))
    assert made == goal()
    assert (made.objects, made.matches, made.targets) == ((1, 2), ((1,), (1,)), (POSE,))
    assert (made.replace, made.rotations, made.metric, made.zones) == (True, True, "pose", ())
    assert (made.max_reward, made.symmetries, made.relation) == (1.0, (0.0, 0.0), None)


def test_cliport_pairs_of_id_and_symmetry_are_understood() -> None:
    assert goal(objs=[(1, (np.pi, None)), (2, (0, None))]).symmetries == (np.pi, 0.0)


def test_cliport_zone_params_with_object_points_are_understood() -> None:
    made = goal(metric="zone", params=({1: np.zeros((3, 4))}, [(POSE, (0.2, 0.2, 0.1))]))
    assert made.zones == (Zone(pose=POSE, size=(0.2, 0.2, 0.1)),)


@pytest.mark.parametrize(
    ("changes", "field", "value"),
    [
        ({"objs": (1, 2)}, "objects", (1, 2)),
        ({"objs": [(1, POSE), 2]}, "objects", (1, 2)),
        ({"targ_poses": [POSE[0]]}, "targets", (POSE,)),
        ({"targ_poses": POSE}, "targets", (POSE,)),
        ({"targ_poses": [POSE[0], POSE[0]], "matches": [[1, 0], [0, 1]]}, "targets", (POSE, POSE)),
        ({"symmetries": [np.pi]}, "symmetries", (np.pi, np.pi)),
        ({"symmetries": [1, 2, 3]}, "symmetries", (1.0, 2.0)),
        ({"symmetries": [7.0, -1]}, "symmetries", (2 * np.pi, 0.0)),
        ({"metric": "zone", "params": (POSE, (0.2, 0.2, 0.0))}, "zones", (Zone(pose=POSE, size=(0.2, 0.2, 0.0)),)),
    ],
)
def test_shapes_that_published_programs_pass_are_understood(changes, field, value) -> None:
    assert getattr(goal(**changes), field) == value


@pytest.mark.parametrize("matches", [None, [1, 1], [[1], [1]], np.ones((2, 2)), np.ones((5, 1)), np.ones((1, 1))])
def test_matches_in_other_shapes_are_understood(matches) -> None:
    assert goal(matches=matches).matches == ((1,), (1,))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"matches": np.ones((0, 1))}, ["(0, 1)", "2 objects", "np.ones((2, 1))"]),
        ({"metric": "near"}, ["'near'", "'pose' or 'zone'"]),
        ({"metric": "zone"}, ["params", "zone_pose"]),
        ({"objs": [None, 2]}, ["None", "env.add_object"]),
        ({"objs": []}, ["objs is empty"]),
        ({"targ_poses": [((0.5, np.nan, 0), POSE[1])]}, ["finite"]),
        ({"step_max_reward": float("nan")}, ["step_max_reward", "1 / len(objects)"]),
        ({"symmetries": [np.nan, 2]}, ["symmetries", "2 objects"]),
    ],
)
def test_what_does_not_fit_is_refused_with_the_value_and_the_remedy(changes, words) -> None:
    with pytest.raises(SimulationError) as caught:
        goal(**changes)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("changes", "message"), [({"objs": None}, "objs is None"), ({"step_max_reward": "all"}, "step_max_reward is 'all'")]
)
def test_arguments_of_a_wrong_kind_are_named(changes, message) -> None:
    with pytest.raises(SimulationError, match=message):
        goal(**changes)
