"""The unseen back of things that the camera sees from the front."""

import math

import numpy as np
import pytest

from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Candidate
from tests.perception.conftest import Rendered, Thing, render

LOW = (-0.3, 0.0, 0.3)
"""A camera that hardly sees the tops."""
THINGS = (
    Thing("cylinder", (0.4, 0.2), (0.07, 0.07, 0.25)),
    Thing("box", (0.4, 0.0), (0.08, 0.06, 0.26), yaw=0.8),
    Thing("cylinder", (0.45, -0.2), (0.1, 0.1, 0.15)),
    Thing("box", (0.65, 0.12), (0.1, 0.06, 0.1)),
)


@pytest.fixture(scope="module")
def front() -> Rendered:
    """Tall things seen from the front, camera calibrated."""
    return render(THINGS, calibrated=True, eye=LOW)


def _candidates(scene: Rendered, labels: np.ndarray) -> tuple[Candidate, ...]:
    return measure_candidates(scene.frame, find_table(scene.frame, np.random.default_rng(0)), labels)


def test_things_seen_from_the_front_are_whole(front: Rendered) -> None:
    for candidate, thing in zip(_candidates(front, front.labels), front.things, strict=True):
        assert candidate.shape == thing.kind
        assert candidate.upright.center == pytest.approx((*thing.center, thing.size[2] / 2), abs=0.01)
        assert sorted(candidate.upright.size) == pytest.approx(sorted(thing.size), abs=0.015)


def test_a_corner_seen_without_its_top_has_its_yaw(front: Rendered) -> None:
    yaw = _candidates(front, front.labels)[1].upright.yaw
    assert math.remainder(yaw - 0.8, math.pi / 2) == pytest.approx(0, abs=0.06)


def test_the_box_holds_the_completed_back(front: Rendered) -> None:
    can = _candidates(front, front.labels)[0]
    assert can.box.size[:2] == pytest.approx((0.07, 0.07), abs=0.015)


def test_a_bottle_is_as_deep_as_its_body() -> None:
    body = Thing("cylinder", (0.45, 0.1), (0.08, 0.08, 0.12))
    neck = Thing("cylinder", (0.45, 0.1), (0.03, 0.03, 0.06), bottom=0.12)
    scene = render((body, neck), calibrated=True, eye=(-0.3, 0.0, 0.2))
    (bottle,) = _candidates(scene, np.minimum(scene.labels, 1))
    assert bottle.shape == "cylinder"
    assert bottle.upright.center == pytest.approx((0.45, 0.1, 0.09), abs=0.01)
    assert bottle.upright.size == pytest.approx((0.08, 0.08, 0.18), abs=0.015)
