"""Touching pieces of one plain colour are joined."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import RGBDFrame
from tests.perception.conftest import Rendered, Thing, render

PLATES = (Thing("box", (0.5, 0.0), (0.1, 0.06, 0.02)), Thing("box", (0.54, 0.0), (0.02, 0.06, 0.08), bottom=0.02))
GREEN = (60, 130, 80)


def _count_segments(frame: RGBDFrame, *without: str) -> int:
    table = find_table(frame, np.random.default_rng(0))
    return int(segment_objects_on_table(frame, table, DEFAULT.segmentation.without_rules(*without)).max())


def _painted(scene: Rendered, *colors: tuple[int, int, int]) -> RGBDFrame:
    """The scene with one colour for each thing, and the grain of a camera."""
    rgb = scene.frame.rgb.astype(np.float64)
    for number, color in enumerate(colors, 1):
        rgb[scene.labels == number] = color
    rgb += np.random.default_rng(0).normal(0, 2, rgb.shape)
    return replace(scene.frame, rgb=np.clip(rgb, 0, 255).astype(np.uint8))


@pytest.fixture(scope="module")
def bracket() -> Rendered:
    """A plate that lies, and one that stands on it."""
    return render(PLATES, noise=0.0005)


@pytest.mark.parametrize(("color", "shadow"), [(GREEN, (45, 98, 60)), ((120,) * 3, (95,) * 3)])
def test_the_plates_of_a_bracket_are_one_object_in_light_and_in_shadow(
    bracket: Rendered, color: tuple[int, int, int], shadow: tuple[int, int, int]
) -> None:
    frame = _painted(bracket, color, shadow)
    assert _count_segments(frame) == 1
    assert _count_segments(frame, "plain_color") == 2


@pytest.mark.parametrize(
    ("color", "other"), [(GREEN, (60, 80, 130)), (GREEN, (75, 130, 60)), ((120, 120, 120), (60, 60, 60))]
)
def test_plates_of_different_colors_are_two_objects(
    bracket: Rendered, color: tuple[int, int, int], other: tuple[int, int, int]
) -> None:
    assert _count_segments(_painted(bracket, color, other)) == 2


def test_plates_of_one_print_are_two_objects(bracket: Rendered) -> None:
    frame = _painted(bracket, GREEN, GREEN)
    rgb, columns = frame.rgb.copy(), np.indices(bracket.labels.shape)[1]
    rgb[(bracket.labels > 0) & (columns % 8 < 4)] = (200, 40, 40)
    assert _count_segments(replace(frame, rgb=rgb)) == 2


def test_a_thing_behind_another_of_its_color_is_an_object() -> None:
    scene = render([Thing("box", (x, 0.0), (0.05, 0.1, 0.08)) for x in (0.42, 0.58)], noise=0.0005)
    assert _count_segments(_painted(scene, GREEN, GREEN)) == 2
