"""The colour of the table is that of most of its pixels."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.table_appearance import measure_table_color
from grs_agents.perception.table_finding import find_table
from tests.perception.conftest import Rendered

WOOD = np.array([150, 140, 130]) / 255  # of the rendered table


def test_things_shadows_and_highlights_hardly_change_it(rendered: Rendered) -> None:
    frame, rng = rendered.frame, np.random.default_rng(0)
    picture = rng.normal(frame.rgb, 4).clip(0, 255)
    picture[:60] = 255
    picture[200:220] *= 0.5
    found = measure_table_color(replace(frame, rgb=picture.astype(np.uint8)), find_table(frame, rng))
    assert found == pytest.approx(tuple(WOOD), abs=0.02)


def test_a_table_that_is_hardly_seen_has_none(rendered: Rendered) -> None:
    frame = rendered.frame
    table = find_table(frame, np.random.default_rng(0))
    depth = np.where(np.arange(frame.depth.size).reshape(frame.depth.shape) < 40, frame.depth, 0)
    assert measure_table_color(replace(frame, depth=depth), table) is None
