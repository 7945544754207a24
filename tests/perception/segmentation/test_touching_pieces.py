"""Touching pieces of one plain colour are joined; so are pieces of one print at a shallow crease, and steep sides."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.piece_joining import join_alike_pieces, join_steep_pieces
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


def _halves(colors: tuple[tuple[int, int, int], ...]) -> tuple[RGBDFrame, np.ndarray]:
    """A wall of the first colour, 1 m away, and two labels of the other two that adjoin before it."""
    labels = np.zeros((120, 160), np.int32)
    labels[40:80, 40:80], labels[40:80, 80:100] = 1, 2
    grain = np.random.default_rng(0).integers(-40, 41, (120, 160, 3))
    rgb = np.clip(np.array(colors)[labels] + grain, 0, 255).astype(np.uint8)
    depth = np.array([1.0, 0.9, 0.9], np.float32)[labels]
    frame = render((), noise=0.0).frame
    size = frame.camera.model_copy(update={"width": 160, "height": 120})
    return RGBDFrame(rgb, depth, size, frame.source), labels


WOOD, RED, BLUE = (150, 140, 130), (180, 60, 60), (60, 80, 170)


@pytest.mark.parametrize(
    ("bend", "color", "pieces"), [(0.2, RED, 1), (0.25, RED, 2), (0.2, BLUE, 2)], ids=["shallow", "deep", "blue"]
)
def test_pieces_of_one_print_at_a_shallow_crease_are_one_object(
    bend: float, color: tuple[int, int, int], pieces: int
) -> None:
    frame, labels = _halves((WOOD, RED, color))
    creases = np.full(labels.shape, bend)
    assert join_alike_pieces(labels, frame, creases, DEFAULT.segmentation).max() == pieces


@pytest.mark.parametrize(("end", "pieces"), [(1.2, 1), (0.95, 2)], ids=["side", "face"])
def test_a_piece_at_a_grazing_angle_is_a_side_of_the_nearer(end: float, pieces: int) -> None:
    frame, labels = _halves((WOOD, RED, BLUE))
    depth = frame.depth.copy()
    depth[40:80, 80:100] = np.linspace(0.91, end, 20, dtype=np.float32)
    assert join_steep_pieces(labels, replace(frame, depth=depth), DEFAULT.segmentation).max() == pieces
