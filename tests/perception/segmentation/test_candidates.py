"""Boxes, shapes and poses of the candidates."""

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion
from grs_agents.library.library import Library
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.segmentation.candidates import (
    center_objects_in_workspace,
    explain_doubt,
    fit_asset_to_box,
    measure_candidates,
)
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Aabb, Candidate, TableFrame, UprightBox, is_reachable_position
from tests.perception.conftest import Rendered, Thing, render

SIDE = st.floats(0.02, 0.3)
ANGLE = st.floats(-math.pi, math.pi)


def _candidates(scene: Rendered) -> tuple[TableFrame, tuple[Candidate, ...]]:
    table = find_table(scene.frame, np.random.default_rng(0))
    return table, measure_candidates(scene.frame, table, scene.labels)


@pytest.mark.parametrize(("side", "is_sure"), [(0.06, True), (0.025, False)])
def test_no_task_can_be_sure_of_what_is_small_across_the_view(side: float, is_sure: bool) -> None:
    scene = render((Thing("box", (0.45, 0.0), (side, side, side)),), noise=0.0, calibrated=True)
    assert (explain_doubt(scene.frame, scene.labels == 1) == "") == is_sure


def test_no_task_can_be_sure_of_what_few_measured_pixels_show() -> None:
    scene = render((Thing("box", (0.45, 0.0), (0.1, 0.1, 0.1)),), noise=0.0, calibrated=True)
    mask = scene.labels == 1
    scene.frame.depth[mask & (np.cumsum(mask.ravel()).reshape(mask.shape) > 100)] = 0
    assert explain_doubt(scene.frame, mask).startswith("seen too sparsely to be sure of it: 100 measured pixels")


def test_boxes_agree_with_the_truth(rendered: Rendered) -> None:
    for candidate, thing in zip(_candidates(rendered)[1], rendered.things, strict=True):
        x, y, z = candidate.upright.center
        assert (x, y, z) == pytest.approx((*thing.center, thing.size[2] / 2), abs=0.01)
        assert sorted(candidate.upright.size) == pytest.approx(sorted(thing.size), abs=0.015)
        assert np.all(np.array(candidate.box.low) < (x, y, z))
        assert np.all(np.array(candidate.box.high) > (x, y, z))


def test_pixels_at_which_the_sensor_saw_past_a_thing_do_not_lengthen_it() -> None:
    scene = render([Thing("box", (0.5, 0.0), (0.06, 0.1, 0.05))])
    own = np.argwhere(scene.labels == 1)
    rows, columns = own[::20].T
    scene.frame.depth[rows, columns] += 0.2
    (found,) = _candidates(scene)[1]
    assert sorted(found.upright.size) == pytest.approx([0.05, 0.06, 0.1], abs=0.015)
    assert found.points < len(own)


def test_a_sheet_on_another_thing_ends_at_the_top_that_was_measured() -> None:
    scene = render(
        [Thing("box", (0.5, 0.0), (0.2, 0.2, 0.05)), Thing("box", (0.5, 0.0), (0.12, 0.14, 0.004), bottom=0.05)]
    )
    sheet = _candidates(scene)[1][1].upright
    assert sheet.center[2] + sheet.size[2] / 2 == pytest.approx(0.054, abs=0.002)
    assert sheet.size[2] == pytest.approx(0.012, abs=0.001)


def test_the_yaw_is_measured(rendered: Rendered) -> None:
    box = _candidates(rendered)[1][0].upright
    assert math.remainder(box.yaw - 0.4, math.pi / 2) == pytest.approx(0, abs=0.05)


def test_shapes_and_hollows(rendered: Rendered) -> None:
    found = _candidates(rendered)[1]
    assert [candidate.shape for candidate in found] == ["box", "cylinder", "cylinder", "box"]
    assert [candidate.hollow for candidate in found] == [False, False, True, False]


def test_what_lies_on_another_thing_starts_at_its_top(stacked: Rendered) -> None:
    lower, upper = _candidates(stacked)[1][:2]
    assert lower.box.low[2] == 0
    assert upper.box.low[2] == pytest.approx(0.06, abs=0.01)


def test_nothing_on_the_table_is_refused() -> None:
    with pytest.raises(InputError, match="nothing on the table"):
        _candidates(render(()))


def test_one_giant_object_is_refused() -> None:
    with pytest.raises(InputError, match="fills the table"):
        _candidates(render([Thing("box", (0.5, 0.0), (0.3, 0.7, 0.1))]))


def test_the_robot_is_placed_only_where_no_calibration_says_so(rendered: Rendered, stacked: Rendered) -> None:
    table, found = _candidates(rendered)
    assert center_objects_in_workspace(table, found) == (table, found)
    table, moved = center_objects_in_workspace(*_candidates(stacked))
    lows, highs = (np.array([getattr(one.box, side) for one in moved]) for side in ("low", "high"))
    assert (lows.min(axis=0) + highs.max(axis=0))[:2] / 2 == pytest.approx((0.5, 0.0), abs=1e-9)


def test_the_robot_stands_where_it_reaches_most_objects() -> None:
    near = [Thing("box", (0.3 + 0.1 * i, -0.45), (0.06, 0.06, 0.08)) for i in range(3)]
    table, found = _candidates(render([*near, Thing("box", (0.55, 0.65), (0.06, 0.06, 0.08))]))
    _, moved = center_objects_in_workspace(table, [moved_aside(item, 3.0) for item in found[3:]] + list(found[:3]))
    assert [is_reachable_position(item.box.center) for item in moved] == [False, True, True, True]


def moved_aside(candidate: Candidate, aside: float) -> Candidate:
    """The candidate, moved to the left by so many metres."""
    (west, south, low), (east, north, high) = candidate.box.low, candidate.box.high
    box = Aabb(low=(west, south + aside, low), high=(east, north + aside, high))
    return replace(candidate, box=box)


def test_crops_show_the_thing_and_dim_the_rest(rendered: Rendered) -> None:
    candidate = _candidates(rendered)[1][0]
    assert candidate.crop.size < rendered.frame.rgb.size
    height, width = candidate.crop.shape[:2]
    color = rendered.frame.rgb[rendered.labels == 1][0]
    assert candidate.crop[height // 2, width // 2].tolist() == color.tolist()
    assert candidate.crop[0, 0].max() < 0.5 * rendered.frame.rgb[0, 0].max()


def test_the_sample_scene_is_measured_from_its_labels(sample_scene: Path) -> None:
    frame = read_scene(sample_scene)
    labels = np.asarray(cv2.imread(str(sample_scene / "labels.png"), cv2.IMREAD_UNCHANGED), np.int32)
    found = measure_candidates(frame, find_table(frame, np.random.default_rng(0)), labels)
    truth = json.loads((sample_scene / "truth.json").read_text())["objects"]
    library = Library()
    for one, known in zip(found, truth, strict=True):
        assert one.upright.center == pytest.approx(known["position"], abs=0.01)
        size = library.asset(known["asset"]).size
        assert sorted(one.upright.size) == pytest.approx(sorted(size), abs=0.015)


def _rotate(q: tuple[float, float, float, float]) -> np.ndarray:
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(a=ANGLE, b=ANGLE, c=ANGLE)
def test_a_quaternion_is_its_rotation(a: float, b: float, c: float) -> None:
    about_z = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    about_y = np.array([[math.cos(c), 0, math.sin(c)], [0, 1, 0], [-math.sin(c), 0, math.cos(c)]])
    rotation = about_z @ about_x @ about_y
    q = matrix_to_quaternion(rotation)
    assert np.linalg.norm(q) == pytest.approx(1)
    assert q[3] >= 0
    assert np.allclose(_rotate(q), rotation, atol=1e-5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_a_turn_has_a_quaternion(axis: int) -> None:
    rotation = -np.eye(3)
    rotation[axis, axis] = 1
    assert np.allclose(_rotate(matrix_to_quaternion(rotation)), rotation)


@given(size=st.tuples(SIDE, SIDE, SIDE), yaw=ANGLE, turn=st.permutations([0, 1, 2]))
def test_a_placed_asset_fills_the_box_it_was_measured_in(
    size: tuple[float, float, float], yaw: float, turn: list[int]
) -> None:
    box = UprightBox(center=(0.5, 0.1, size[2] / 2), size=size, yaw=yaw)
    asset = (size[turn[0]], size[turn[1]], size[turn[2]])
    position, orientation, extents = fit_asset_to_box(box, asset)
    assert position[2] - extents[2] / 2 == pytest.approx(0, abs=1e-9)
    assert position[:2] == box.center[:2]
    cosine, sine = math.cos(-yaw), math.sin(-yaw)
    local = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ _rotate(orientation)
    assert np.abs(local) @ np.array(asset) == pytest.approx(extents, abs=1e-6)
    misfit = float(np.abs(np.log(np.array(extents) / np.array(size))).sum())
    assert misfit <= 0.05 + 1e-6


def test_an_upright_asset_stays_upright() -> None:
    box = UprightBox(center=(0.5, 0.0, 0.08), size=(0.05, 0.07, 0.16), yaw=0.3)
    assert _rotate(fit_asset_to_box(box, (0.05, 0.065, 0.155))[1])[2, 2] == pytest.approx(1)
