"""Heaps: things come to rest, on the table or on one another, and none is inside another."""

import numpy as np
import pytest

from evals.synthesis import SynthesisError
from evals.synthesis.clutter import CENTER, REACH, settle_heap
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion

_NAMES = "HOPE/Milk HOPE/Cookies block/red_block HOPE/Tuna bowl/bowl HOPE/Corn HOPE/Popcorn mug/mug"
OBJECTS = tuple(f"{name}.urdf" for name in _NAMES.split())


def test_heaps_rest_on_the_table_and_some_things_on_others() -> None:
    library, stacked = Library(), 0
    for seed in range(3):
        resting = settle_heap(OBJECTS, library, np.random.default_rng(seed))
        assert tuple(one.asset for one in resting) == OBJECTS
        lows: list[float] = []
        for one in resting:
            (x, y, z), rotation = one.pose
            corners = np.array(np.meshgrid(*np.array(library.load_object_model(one.asset).bounds).T)).reshape(3, -1)
            lows.append(z + float((matrix_from_quaternion(rotation) @ corners)[2].min()))
            assert np.hypot(x - CENTER[0], y - CENTER[1]) < REACH
        assert sum(abs(low) < 0.004 for low in lows) >= 3
        stacked += sum(low > 0.01 for low in lows)
    assert stacked >= 2


def test_the_same_seed_makes_the_same_heap() -> None:
    one, same = (settle_heap(OBJECTS[:4], Library(), np.random.default_rng(8)) for _ in range(2))
    assert one == same


def test_what_finds_no_rest_is_refused() -> None:
    with pytest.raises(SynthesisError, match="did not come to rest"):
        settle_heap(["container/open_box.urdf"] * 40, Library(), np.random.default_rng(0))
