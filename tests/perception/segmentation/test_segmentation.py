"""Whole segmentations, against the truth of synthetic and real scenes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import RGBDFrame
from tests.perception.conftest import Rendered, Thing, render
from tests.pictures import read_picture


def _segment(frame: RGBDFrame) -> np.ndarray:
    return segment_objects_on_table(frame, find_table(frame, np.random.default_rng(0)))


def _ious(found: np.ndarray, truth: np.ndarray) -> list[float]:
    """For each true object, the best overlap with a segment."""
    masks = [found == label for label in range(1, int(found.max()) + 1)]
    wholes = [truth == label for label in np.unique(truth) if label]
    return [max(float((whole & mask).sum() / (whole | mask).sum()) for mask in masks) for whole in wholes]


def test_separate_things_are_found_whole(rendered: Rendered) -> None:
    labels = _segment(rendered.frame)
    assert labels.max() == 4
    assert min(_ious(labels, rendered.labels)) > 0.85


def test_stacked_and_touching_things_are_told_apart(stacked: Rendered) -> None:
    labels = _segment(stacked.frame)
    assert labels.max() == 4
    assert min(_ious(labels, stacked.labels)) > 0.75


@pytest.mark.parametrize(("depth", "objects"), [(0.02, 1), (0.05, 2)], ids=["tab", "box"])
def test_a_tab_in_front_of_a_box_is_part_of_it_and_a_smaller_box_is_not(depth: float, objects: int) -> None:
    box = Thing("box", (0.5, 0.0), (0.1, 0.12, 0.16))
    front = Thing("box", (0.45 - depth / 2, 0.0), (depth, 0.05, 0.08))
    assert _segment(render((box, front), calibrated=True).frame).max() == objects


def test_a_veil_of_mixed_pixels_is_no_thing(rendered: Rendered) -> None:
    depth = rendered.frame.depth.copy()
    depth[60:72, 200:214] *= np.linspace(0.85, 1, 14, dtype=np.float32)
    assert _segment(replace(rendered.frame, depth=depth)).max() == 4


@pytest.mark.parametrize(("width", "objects"), [(6, 4), (14, 5)], ids=["sliver", "bar"])
def test_a_strip_as_narrow_as_the_flying_pixels_at_its_edges_is_no_object(
    rendered: Rendered, width: int, objects: int
) -> None:
    depth = rendered.frame.depth.copy()
    rgb = rendered.frame.rgb.copy()
    depth[60:95, 200 : 200 + width] *= np.float32(0.95)
    rgb[60:95, 200 : 200 + width] = (60, 80, 130)
    frame = replace(rendered.frame, depth=depth, rgb=rgb)
    assert _segment(frame).max() == objects
    table = find_table(frame, np.random.default_rng(0))
    assert segment_objects_on_table(frame, table, DEFAULT.segmentation.without_rules("flying_pixels")).max() == 5


def test_an_empty_table_has_no_segments() -> None:
    assert _segment(render(()).frame).max() == 0


def test_the_sample_scene_has_its_eleven_objects(sample_scene: Path) -> None:
    labels = _segment(read_scene(sample_scene))
    truth = read_picture(sample_scene / "labels.png")
    assert labels.max() == 11
    assert min(_ious(labels, truth)) > 0.75


@pytest.mark.parametrize(
    ("name", "share"),
    [("osd_learn33", 0.99), ("osd_test51", 0.99), ("osd_test55", 0.95), ("osd_test59", 0.95), ("6dof_red_mug", 0.99)],
)
def test_real_scenes(real_scenes: Path, name: str, share: float) -> None:
    labels = _segment(read_scene(real_scenes / name))
    overlaps = _ious(labels, read_picture(real_scenes / name / "labels.png"))
    assert np.mean([overlap > 0.5 for overlap in overlaps]) >= share
    assert labels.max() <= 1.2 * len(overlaps) + ("6dof" in name)
