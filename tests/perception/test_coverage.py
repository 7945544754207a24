"""Coverage: which part of what rises above the table belongs to objects."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from grs_agents.perception.coverage import describe_coverage, measure_coverage, raised_pixel_mask
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame
from tests.needs import REAL_SCENES, needs
from tests.perception import room

THING, OTHER = room.THINGS


Seen = tuple[RGBDFrame, TableFrame, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def seen() -> Seen:
    """A room with two things on a table, the table in it, what each pixel shows, and the segments."""
    frame, _, owner = room.photo(room.camera(width=640, height=480), noise=0.001)
    table = find_table(frame, np.random.default_rng(0))
    return frame, table, owner, segment_objects_on_table(frame, table)


def segments_of(seen: Seen, things: tuple[int, ...]) -> Mask:
    """The pixels of the segments of some things."""
    _, _, owner, labels = seen
    return np.isin(labels, np.unique(labels[np.isin(owner, things) & (labels > 0)]))


def test_what_rises_is_what_stands_on_the_table(seen: Seen) -> None:
    frame, table, owner, _ = seen
    above, things = raised_pixel_mask(frame, table), np.isin(owner, room.THINGS)
    assert np.count_nonzero(above & things) > 0.96 * np.count_nonzero(things)
    assert np.count_nonzero(above & ~things) < 0.02 * np.count_nonzero(things)
    assert not (raised_pixel_mask(frame, table, left_out=owner == THING) & (owner == THING)).any()


@pytest.mark.parametrize("things", [(), (THING,), (OTHER,), room.THINGS])
def test_the_share_is_the_true_one(seen: Seen, things: tuple[int, ...]) -> None:
    frame, table, owner, _ = seen
    mask, true = segments_of(seen, things), np.isin(owner, room.THINGS)
    found = measure_coverage(frame, table, raised_pixel_mask(frame, table), mask)
    assert found.share == pytest.approx(np.count_nonzero(mask & true) / np.count_nonzero(true), abs=0.03)
    missing = [number for number in room.THINGS if number not in things]
    assert sum(region.share > 0.1 for _, region in found.regions) == len(missing)


def test_what_no_object_owns_is_told_with_place_and_reason(seen: Seen, tmp_path: Path) -> None:
    frame, table, owner, _ = seen
    rejected: list[tuple[Mask, str]] = [(owner == THING, "described as no object: a stain")]
    found = measure_coverage(frame, table, raised_pixel_mask(frame, table), segments_of(seen, (OTHER,)), rejected)
    coverage = found.write(frame, tmp_path)
    largest = coverage.unowned[0]
    assert largest.reason == "dropped: described as no object: a stain"
    low, high = room.BOXES[THING]
    assert (low - 0.02 < largest.box.center).all() and (largest.box.center < high + 0.02).all()
    assert "described as no object" in describe_coverage(coverage)
    assert f"{coverage.share:.2f}" in describe_coverage(coverage)
    drawn = cv2.imread(str(tmp_path / coverage.picture))
    assert drawn is not None and drawn.shape[1] == 1024


def test_a_side_without_depth_still_rises(seen: Seen) -> None:
    frame, table, owner, _ = seen
    inside = cv2.erode((owner == THING).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    depth = np.where(inside, 0, frame.depth).astype(np.float32)
    blind = RGBDFrame(frame.rgb, depth, frame.camera, frame.source)
    assert raised_pixel_mask(blind, table)[inside].all()
    found = measure_coverage(
        blind, table, raised_pixel_mask(blind, table), (owner == OTHER) | (owner == THING) & ~inside
    )
    assert found.regions[0][1].reason == "no depth"


def test_the_floor_of_a_box_rises_and_what_lies_among_walls_on_the_table_does_not() -> None:
    walls = [(0.4, -0.1, 0.6, -0.09), (0.4, 0.09, 0.6, 0.1), (0.4, -0.09, 0.41, 0.09), (0.59, -0.09, 0.6, 0.09)]
    sides = [((x, y, 0.0), (far, left, 0.03)) for x, y, far, left in walls]
    inside = (0.41, -0.09), (0.59, 0.09)
    for thick, rises in ((0.003, True), (0.0, False)):
        floor = [((*inside[0], 0.0), (*inside[1], thick))] if thick else []
        boxes = np.concatenate([room.BOXES[:4], np.array(sides + floor)])
        frame, _, owner = room.photo(room.camera(width=640, height=480), noise=0.002, boxes=boxes)
        table = find_table(frame, np.random.default_rng(0))
        points = robot_frame_point_map(frame, table)[..., :2]
        own = ((points > np.add(inside[0], 0.02)) & (points < np.subtract(inside[1], 0.02))).all(axis=-1) & (owner < 4)
        own |= owner == 8
        assert np.count_nonzero(own) > 500
        assert (raised_pixel_mask(frame, table)[own].mean() > 0.9) == rises


@pytest.mark.parametrize(("thick", "rises"), [(0.005, True), (0.0, False)])
def test_a_floor_rises_up_to_the_robot_that_hides_a_part_of_it(thick: float, rises: bool) -> None:
    walls = [(0.4, -0.1, 0.6, -0.09), (0.4, 0.09, 0.6, 0.1), (0.4, -0.09, 0.41, 0.09), (0.59, -0.09, 0.6, 0.09)]
    sides = [((x, y, 0.0), (far, left, 0.03)) for x, y, far, left in walls]
    floor = [((0.41, -0.09, 0.0), (0.59, 0.09, thick))] if thick else []
    boxes = np.concatenate([room.BOXES[:4], np.array(sides + floor)])
    frame, points, owner = room.photo(room.camera(width=640, height=480), noise=0.002, boxes=boxes)
    arm = np.zeros(owner.shape, np.bool_)
    arm[:, 330:370] = True
    inside = (points[..., 0] > 0.43) & (points[..., 0] < 0.57) & (np.abs(points[..., 1]) < 0.07) & ~arm
    beside = inside & np.asarray(cv2.dilate(arm.astype(np.uint8), np.ones((11, 11), np.uint8)), np.bool_)
    assert np.count_nonzero(beside) > 100
    found = raised_pixel_mask(frame, find_table(frame, np.random.default_rng(0)), left_out=arm)
    assert (found[beside].mean() > 0.9) == rises and not found[arm].any()


@pytest.mark.parametrize(
    ("known", "height", "counts"), [(True, 0.06, True), (False, 0.06, False), (True, 0.015, False)]
)
def test_what_is_high_beside_the_robot_counts_and_what_is_beside_a_wall_does_not(
    known: bool, height: float, counts: bool
) -> None:
    boxes = np.concatenate([room.BOXES[:4], [((0.45, -0.05, 0.0), (0.5, 0.05, height))]])
    frame, _, owner = room.photo(room.camera(width=640, height=480), boxes=boxes)
    own = owner == 4
    strip = own & (np.cumsum(own, axis=1) <= 7)  # from its left edge on
    left_out = own & ~strip
    table = find_table(frame, np.random.default_rng(0))
    found = raised_pixel_mask(frame, table, left_out, left_out if known else np.zeros_like(own))
    at = cv2.dilate(left_out.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert np.count_nonzero(strip & ~at) > 100
    assert (found[strip & ~at].mean() > 0.5) == counts
    assert not found[at].any()


def test_where_the_blurred_edge_of_the_robot_ends_is_table(seen: Seen) -> None:
    frame, table, owner, _ = seen
    height = np.asarray(table.T_robot_cam)[2, 3]
    away = cv2.distanceTransform((owner != THING).astype(np.uint8), cv2.DIST_L2, 5)
    raised = np.where((away > 0) & (away < 6), 0.014, np.where((away > 0) & (away < 13), 0.005, 0.0))
    depth = np.where(owner == 0, frame.depth * (height - raised) / height, frame.depth).astype(np.float32)
    blurred = RGBDFrame(frame.rgb, depth, frame.camera, frame.source)
    found = raised_pixel_mask(blurred, table, left_out=owner == THING)
    assert not found[(away > 0) & (away < 20) & (owner == 0)].any()


@pytest.mark.parametrize("around", [True, False])
def test_what_only_the_blurred_edge_of_the_robot_encloses_is_table(around: bool) -> None:
    sides = [(0.4, -0.1, 0.6, -0.096), (0.4, 0.096, 0.6, 0.1), (0.4, -0.096, 0.404, 0.096), (0.596, -0.096, 0.6, 0.096)]
    blur = [((x, y, 0.0), (far, left, 0.025)) for x, y, far, left in sides]
    boxes = np.concatenate([room.BOXES[:4], np.array([*blur, ((0.404, -0.096, 0.0), (0.596, 0.096, 0.003))])])
    frame, _, owner = room.photo(room.camera(width=640, height=480), noise=0.001, boxes=boxes)
    bottom = owner == 8
    near, far = (cv2.dilate(bottom.astype(np.uint8), np.ones((width, width), np.uint8)) > 0 for width in (7, 41))
    arm = far & ~near if around else np.zeros_like(bottom)
    found = raised_pixel_mask(frame, find_table(frame, np.random.default_rng(0)), left_out=arm)
    inner = cv2.erode(bottom.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    assert inner.sum() > 500
    assert found[inner].any() != around


def test_a_near_wall_rises_though_the_table_beside_it_is_hidden() -> None:
    wall = np.array([((0.3, -0.2, 0.0), (0.32, 0.2, 0.08))])
    boxes = np.concatenate([room.BOXES[:4], wall])
    frame, points, owner = room.photo(room.camera(width=640, height=480), boxes=boxes)
    rows, columns = np.nonzero(owner == 4)
    left, right, bottom = columns.min() + 20, columns.max() - 20, rows.max() - 2  # no table is before it nor beside it
    depth = np.where((owner == 0) & (points[..., 0] < 0.39), np.float32(0), frame.depth)  # and some behind it is hidden
    update = {"height": int(bottom), "width": int(right - left), "cx": frame.camera.cx - float(left)}
    camera = frame.camera.model_copy(update=update)
    seen = RGBDFrame(frame.rgb[:bottom, left:right], depth[:bottom, left:right], camera, frame.source)
    found = raised_pixel_mask(seen, find_table(seen, np.random.default_rng(0)))
    assert found[owner[:bottom, left:right] == 4].mean() > 0.95


def test_what_was_not_measured_does_not_count(seen: Seen) -> None:
    frame, table, owner, _ = seen
    hidden = cv2.erode((owner == THING).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    blind = RGBDFrame(frame.rgb, np.where(hidden, np.float32(0), frame.depth), frame.camera, frame.source)
    owned = np.isin(owner, room.THINGS) & ~hidden
    assert measure_coverage(blind, table, raised_pixel_mask(blind, table), owned).share > 0.97


REAL = ("osd_test20", "osd_test45", "osd_test55", "osd_test61")


@needs("real scenes")
@pytest.mark.parametrize("name", REAL)
def test_the_share_is_right_within_three_points_on_real_photos(name: str) -> None:
    frame = read_scene(REAL_SCENES / name)
    table = find_table(frame, np.random.default_rng(0))
    truth = np.asarray(cv2.imread(str(REAL_SCENES / name / "labels.png"), cv2.IMREAD_UNCHANGED)) > 0
    labels = segment_objects_on_table(frame, table)
    owned = (labels > 0) & (labels != 1)
    found = measure_coverage(frame, table, raised_pixel_mask(frame, table), owned)
    assert found.share == pytest.approx(np.count_nonzero(owned & truth) / np.count_nonzero(truth), abs=0.03)


@needs("real scenes")
@pytest.mark.parametrize("name", ["uois_0", "uois_4"])
def test_the_blurred_far_edge_of_a_real_table_is_nothing_that_was_missed(name: str) -> None:
    frame = read_scene(REAL_SCENES / name)
    table = find_table(frame, np.random.default_rng(0))
    labels = segment_objects_on_table(frame, table)
    assert measure_coverage(frame, table, raised_pixel_mask(frame, table), labels > 0).share > 0.85
