"""Names of colours."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.library.colors import COLORS, color_name_from_rgb


@pytest.mark.parametrize("name", COLORS)
def test_every_colour_of_the_palette_has_its_own_name(name: str) -> None:
    assert color_name_from_rgb(COLORS[name]) == name


@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_every_colour_has_a_name_of_the_palette(rgb: tuple[float, float, float]) -> None:
    assert color_name_from_rgb(rgb) in COLORS
