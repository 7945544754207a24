"""Each rule of segmentation changes something, and can be switched off."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.base.errors import UnknownNameError
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.configuration import RULES
from grs_agents.perception.segmentation.part_merging import merge_parts
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import RGBDFrame
from tests.perception.conftest import Thing, render

FRONT = Thing("box", (0.44, 0.0), (0.02, 0.05, 0.08))
SCENES: dict[str, tuple[Thing, ...]] = {
    "hollow_floor": (Thing("cylinder", (0.45, 0.05), (0.2, 0.2, 0.05), wall=0.004),),
    "tab": (Thing("box", (0.5, 0.0), (0.1, 0.12, 0.16)), FRONT),
    "cap": (Thing("box", (0.5, 0.0), (0.1, 0.12, 0.16)), Thing("box", (0.5, 0.0), (0.03, 0.04, 0.03), bottom=0.16)),
    "sensor_noise": (Thing("box", (0.4, 0.0), (0.04, 0.04, 0.0115)),),
}


def _frame(rule: str) -> RGBDFrame:
    """A photo in which all things have the same colours, and none a plain one, but for noise: it looks like the
    table."""
    scene = render(SCENES[rule], noise=0.0, calibrated=True)
    print_of_all = np.random.default_rng(0).integers(60, 200, scene.frame.rgb.shape, np.uint8)
    if rule == "sensor_noise":
        print_of_all = np.full_like(print_of_all, scene.frame.rgb[scene.labels == 0][0])
    rgb = np.where(scene.labels[..., None] > 0, print_of_all, scene.frame.rgb)
    return replace(scene.frame, rgb=rgb)


@pytest.mark.parametrize("rule", SCENES)
def test_a_rule_that_is_off_changes_the_segments(rule: str) -> None:
    frame = _frame(rule)
    table = find_table(frame, np.random.default_rng(0))
    on = segment_objects_on_table(frame, table)
    off = segment_objects_on_table(frame, table, DEFAULT.segmentation.without_rules(rule))
    assert (on != off).any()


def _plate(x: float, y: float, z: float, length: float, width: float) -> np.ndarray:
    """(20, 20, 3) points of a level plate."""
    along, across = np.meshgrid(np.linspace(0, length, 20), np.linspace(0, width, 20))
    return np.stack([x + along, y + across, np.full_like(along, z)], axis=-1)


def _count(points: np.ndarray, labels: np.ndarray, *without: str, colors: tuple[int, ...] = (0, 90, 90)) -> int:
    """How many parts are left; ``colors`` are the shades of red of the table and of each part."""
    rgb = np.stack([np.take(colors, labels), np.full(labels.shape, 90), np.full(labels.shape, 90)], axis=-1)
    config = DEFAULT.segmentation.without_rules(*without)
    return len(np.unique(merge_parts(labels, points, rgb.astype(np.uint8), config)))


def test_the_walls_of_a_box_are_two_without_the_rule_of_the_common_rim() -> None:
    x, y = np.meshgrid(np.linspace(0, 0.25, 120), np.linspace(0, 0.2, 110))
    edge = np.minimum(np.minimum(x, 0.25 - x), np.minimum(y, 0.2 - y))
    points = np.stack([x, y, np.where(edge < 0.012, 0.09, 0.012)], axis=-1)
    labels = np.where(x < 0.125, 1, 2).astype(np.int32)
    assert (_count(points, labels), _count(points, labels, "common_rim")) == (1, 2)
    assert _count(points, labels, colors=(0, 90, 200)) == 1  # a wall in its own shadow looks otherwise


def test_a_handle_is_a_part_of_its_own_without_the_rule_of_what_is_unsupported_or_in_another_colour() -> None:
    points = np.concatenate(
        [_plate(0, 0, z, 0.1, 0.1) for z in (0.06, 0.08, 0.1)] + [_plate(0.095, 0.04, 0.097, 0.08, 0.02)]
    )
    labels = np.repeat(np.array([1, 1, 1, 2], np.int32), 20)[:, None] * np.ones(20, np.int32)
    assert (_count(points, labels), _count(points, labels, "unsupported")) == (1, 2)
    assert _count(points, labels, colors=(0, 90, 200)) == 2


def test_an_unknown_rule_is_told_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError) as error:
        DEFAULT.segmentation.without_rules("rims")
    assert "common_rim" in str(error.value)
    assert set(error.value.valid) == set(RULES)
