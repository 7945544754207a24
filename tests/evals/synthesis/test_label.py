"""Labels are drawn for every design."""

import numpy as np
import pytest

from evals.synthesis.label import SIDE, bgr, label_texture
from evals.synthesis.packages import Package
from scripts.assets.grocery_table import GROCERIES


@pytest.mark.parametrize("grocery", GROCERIES[::5], ids=lambda grocery: grocery.kind)
def test_a_label_shows_its_colours(grocery: Package) -> None:
    image = label_texture(grocery.label, (0.06, 0.06), grocery.size[2], printed_cap=False)
    assert image.shape == (SIDE, SIDE, 3)
    for color in (grocery.label.base, grocery.label.band):
        near = (np.abs(image.astype(int) - bgr(color)) < 12).all(axis=2)
        assert near.mean() > 0.01


def test_colours_are_blue_green_red() -> None:
    assert bgr("ff8001") == (1, 128, 255)
