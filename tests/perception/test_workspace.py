"""Where the arm works."""

import pytest

from grs_agents.perception.types import FARTHEST, is_reachable_position
from grs_agents.perception.types import NEAREST as WORKSPACE_NEAREST
from grs_agents.sim.arms.ur5e import NEAREST, REACH


@pytest.mark.parametrize(
    ("position", "inside"),
    [
        ((0.5, 0.0, 0.1), True),
        ((0.26, 0.0, 0.0), True),
        ((0.2, 0.0, 0.0), False),
        ((0.5, 0.51, 0.0), False),
        ((0.74, 0.49, 0.0), False),
    ],
)
def test_reachable(position: tuple[float, float, float], inside: bool) -> None:
    assert is_reachable_position(position) is inside


def test_the_workspace_agrees_with_the_arm() -> None:
    assert (WORKSPACE_NEAREST, FARTHEST) == (NEAREST, REACH)
