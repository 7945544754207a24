"""One small synthesised scene for all tests."""

import pytest

from evals.synthesis import Recipe, SynthesisedScene, synthesise
from grs_agents.library.library import Library

SMALL = Recipe(seed=5, objects=4, distractors=1, tilt=50.0, sensor="time_of_flight", width=160, height=120)


@pytest.fixture(scope="session")
def small() -> SynthesisedScene:
    """Four things, one of them strange, seen by a camera of 160 x 120 pixels."""
    return synthesise(SMALL, Library())
