"""Walls of a bin: found whatever their direction and whatever hides them, and told from boxes among the things."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from evals.benchmark.ground_truth import read_labelled
from evals.synthesis import Recipe, recipes, synthesise
from grs_agents.library.library import Library
from grs_agents.perception.bin_walls.bin_walls import find_bin_walls
from grs_agents.perception.robot_pixels import robot_pixel_mask
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import RGBDFrame
from tests.perception import room

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
FIRST = len(room.BOXES)
"""The number of the first wall."""


def walls_around(low: tuple[float, float], high: tuple[float, float], height: float, thick: float = 0.01) -> list[Box]:
    """Four walls on the table, between the outer corners ``low`` and ``high``, m."""
    (x, y), (far, left) = low, high
    sides = [
        (x, y, far, y + thick),
        (x, left - thick, far, left),
        (x, y + thick, x + thick, left - thick),
        (far - thick, y + thick, far, left - thick),
    ]
    return [((a, b, 0.0), (c, d, height)) for a, b, c, d in sides]


BIN = walls_around((0.3, -0.3), (0.72, 0.3), 0.08)


def found_in(
    boxes: list[Box], hidden: np.ndarray | None = None, yaw: float = 0.0, calibrated: bool = True, noise: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """The pixels found, and the number of the box in each pixel, of a room with ``boxes``; ``hidden`` is the robot."""
    frame, _, owner = room.photo(
        room.camera(yaw=yaw, width=640, height=480), noise, np.concatenate([room.BOXES, np.array(boxes)])
    )
    if not calibrated:
        camera = frame.camera.model_copy(update={"T_robot_cam": None})
        frame = RGBDFrame(frame.rgb, frame.depth, camera, frame.source)
    robot = np.zeros(owner.shape, bool) if hidden is None else hidden
    return find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), robot).pixels, owner


def assert_walls_found(found: np.ndarray, owner: np.ndarray, least: float = 0.9) -> None:
    walls = owner >= FIRST
    assert np.count_nonzero(found & walls) > least * np.count_nonzero(walls) > 1000
    assert np.count_nonzero(found & np.isin(owner, room.THINGS)) < 0.01 * np.isin(owner, room.THINGS).sum()
    assert np.count_nonzero(found & ~walls) < 0.15 * np.count_nonzero(walls)


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize(("yaw", "calibrated"), [(0.0, True), (0.6, True), (0.6, False)])
def test_walls_are_found_in_any_direction(yaw: float, calibrated: bool, noise: float) -> None:
    assert_walls_found(*found_in(BIN, yaw=yaw, calibrated=calibrated, noise=noise))


def test_walls_that_the_robot_hides_in_part_are_found() -> None:
    arm = np.zeros((480, 640), bool)
    arm[:, 440:560] = True
    found, owner = found_in(BIN, hidden=arm)
    assert not (found & arm).any()
    assert_walls_found(found, np.where(arm, -1, owner))


def test_walls_are_found_where_the_robot_hides_most_of_the_longest_rim() -> None:
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, np.concatenate([room.BOXES, np.array(BIN)]))
    table = find_table(frame, np.random.default_rng(0))
    points = robot_frame_point_map(frame, table)
    arm = (owner == FIRST + 2) & (points[..., 2] > 0.045) & (points[..., 1] > -0.2)
    assert np.count_nonzero(arm) > 300
    found, owner = found_in(BIN, hidden=arm)
    assert_walls_found(found, np.where(arm, -1, owner))


def test_three_walls_are_found_where_the_robot_hides_the_fourth_with_its_corners() -> None:
    owner = room.photo(room.camera(width=640, height=480), boxes=np.concatenate([room.BOXES, np.array(BIN)]))[2]
    arm = cv2.dilate((owner == FIRST).astype(np.uint8), np.ones((25, 25))) > 0
    assert (owner[arm] < FIRST).any()
    found, owner = found_in(BIN, hidden=arm)
    assert_walls_found(found, np.where(arm, -1, owner))


def test_a_wall_is_found_of_which_the_robot_leaves_a_narrow_strip() -> None:
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, np.concatenate([room.BOXES, np.array(BIN)]))
    heights = robot_frame_point_map(frame, find_table(frame, np.random.default_rng(0)))[..., 2]
    far = owner == FIRST + 3
    arm = cv2.dilate((far & (heights > 0.038)).astype(np.uint8), np.ones((25, 1))) > 0
    arm &= ~far | (heights > 0.038)
    strip = far & ~arm
    assert strip.any(axis=0).any() and strip.sum(axis=0).max() <= 14
    found, _ = found_in(BIN, hidden=arm)
    assert np.count_nonzero(found & strip) > 0.8 * np.count_nonzero(strip) > 100


def test_a_box_along_the_bin_is_no_wall_where_longer_walls_go_on_beyond_it() -> None:
    boxes = [*walls_around((0.3, -0.2), (0.85, 0.2), 0.08), ((0.42, -0.18, 0.0), (0.435, 0.18, 0.08))]
    owner = room.photo(room.camera(width=640, height=480), boxes=np.concatenate([room.BOXES, np.array(boxes)]))[2]
    near, box = owner == FIRST + 2, owner == FIRST + 4
    found, _ = found_in(boxes, hidden=near)
    assert np.count_nonzero(found & box) < 0.02 * np.count_nonzero(box)
    walls = (owner >= FIRST) & ~near & ~box
    assert np.count_nonzero(found & walls) > 0.9 * np.count_nonzero(walls) > 1000


def test_walls_that_go_on_beyond_the_picture_are_found() -> None:
    assert_walls_found(*found_in(walls_around((0.3, -0.8), (0.72, 0.3), 0.08)))


@pytest.mark.parametrize("left", [0.07, 0.03])
def test_a_wall_is_found_of_which_only_what_is_low_is_in_the_picture(left: float) -> None:
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, np.concatenate([room.BOXES, np.array(BIN)]))
    heights = robot_frame_point_map(frame, find_table(frame, np.random.default_rng(0)))[..., 2]
    far = owner == FIRST + 3
    cut = int(np.flatnonzero((far & (heights > left)).any(axis=1))[-1]) + 1
    camera = frame.camera.model_copy(update={"height": 480 - cut, "cy": frame.camera.cy - cut})
    frame = RGBDFrame(frame.rgb[cut:], frame.depth[cut:], camera, frame.source)
    owner = owner[cut:]
    nothing = np.zeros(owner.shape, bool)
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), nothing).pixels
    assert_walls_found(found, owner)
    assert np.count_nonzero(found & far[cut:]) > 0.8 * np.count_nonzero(far[cut:]) > 100


@pytest.mark.parametrize("beside_robot", [False, True])
def test_a_small_piece_of_wall_at_the_border_is_found(beside_robot: bool) -> None:
    boxes = np.concatenate([room.BOXES, np.array(BIN)])
    frame, _, owner = room.photo(room.camera(yaw=0.3, width=640, height=480), 0.0, boxes)
    heights = robot_frame_point_map(frame, find_table(frame, np.random.default_rng(0)))[..., 2]
    cut = int(np.flatnonzero((owner == FIRST + 3).any(axis=1))[-1]) - 10
    camera = frame.camera.model_copy(update={"height": 480 - cut, "cy": frame.camera.cy - cut})
    frame = RGBDFrame(frame.rgb[cut:], frame.depth[cut:], camera, frame.source)
    piece = ((owner == FIRST + 3) & (heights > 0.01))[cut:]
    robot = np.zeros(piece.shape, bool)
    if beside_robot:  # which hides where it meets other walls
        rows, columns = (np.flatnonzero(piece.any(axis=axis)) for axis in (1, 0))
        robot[: rows[-1] + 8, columns[len(columns) * 2 // 3] :] = True
        piece &= ~robot
        mixed = piece & (np.cumsum(piece[:, ::-1], axis=1)[:, ::-1] == 1)
        depth = np.where(mixed, frame.depth - 0.15, frame.depth).astype(np.float32)
        frame = RGBDFrame(frame.rgb, depth, camera, frame.source)
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), robot).pixels
    assert np.count_nonzero(found & piece) > 0.8 * np.count_nonzero(piece) > 50


def test_only_what_lies_beyond_a_wall_and_beside_the_robot_may_mix_both() -> None:
    boxes = np.concatenate([room.BOXES, np.array([*BIN, ((0.45, 0.37, 0.0), (0.6, 0.4, 0.05))])])
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, boxes)
    outside, robot = owner == len(boxes) - 1, np.zeros(owner.shape, bool)
    rows, columns = (np.flatnonzero(outside.any(axis=axis)) for axis in (1, 0))
    robot[rows[0] : rows[-1], : columns[0] + 10] = True
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), robot)
    assert len(found.walls) == 4
    beside = np.zeros_like(robot)
    beside[rows[0] : rows[-1], columns[0] + 10 : columns[0] + 20] = True
    assert found.mixed[outside & beside].all() and np.count_nonzero(outside & beside) > 50
    assert not found.mixed[outside & (np.arange(640) > columns[0] + 40)].any()


def test_walls_are_found_where_the_depth_behind_a_rim_is_mixed() -> None:
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, np.concatenate([room.BOXES, np.array(BIN)]))
    far = (owner == FIRST + 3).astype(np.uint8)
    behind = (cv2.dilate(far, np.ones((5, 1), np.uint8), anchor=(0, 0)) > 0) & (owner < 4)
    rim = cv2.erode(np.where(far > 0, frame.depth, np.float32(9)), np.ones((6, 1)), anchor=(0, 0))
    mixed = np.where(behind & (rim < 9), (rim + frame.depth) / 2, frame.depth).astype(np.float32)
    assert np.count_nonzero(mixed != frame.depth) > 500
    frame = RGBDFrame(frame.rgb, mixed, frame.camera, frame.source)
    nothing = np.zeros(owner.shape, bool)
    assert_walls_found(find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), nothing).pixels, owner)


def test_a_line_of_mixed_depth_behind_a_rim_is_not_the_rim(tmp_path: Path) -> None:
    """A made scene: a time-of-flight camera sees points in the air behind a rim that the arm hides in part."""
    library = Library()
    recipe = recipes(40, 69_000, Recipe(objects=15, absent=5, arm=True, walls=True))[3]
    scene = synthesise(recipe, library)
    scene.write(tmp_path)
    frame = read_labelled(tmp_path).frame
    robot = robot_pixel_mask(frame, "ur5e", library)
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), robot).pixels
    walls = scene.walls & ~robot & (frame.depth > 0)
    assert (found & walls).sum() > 0.9 * walls.sum() > 10_000


def test_without_walls_nothing_is_found() -> None:
    assert not found_in([((0.6, -0.3, 0.0), (0.7, -0.25, 0.1))])[0].any()


def test_a_box_that_things_stand_beside_is_no_bin() -> None:
    beside = walls_around((0.35, -0.4), (0.65, -0.2), 0.08)
    assert not found_in(beside)[0].any()


def test_a_box_with_one_thing_in_it_is_no_bin() -> None:
    around = walls_around((0.35, -0.3), (0.65, 0.05), 0.08)
    boxes = np.concatenate([room.BOXES[:5], np.array(around)])
    frame, _, _ = room.photo(room.camera(width=640, height=480), boxes=boxes)
    robot = np.zeros((480, 640), bool)
    assert not find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), robot).pixels.any()


def test_two_walls_are_no_bin_if_the_others_are_missing() -> None:
    assert not found_in(BIN[:1] + BIN[2:3])[0].any()


def test_things_that_hide_each_other_in_the_picture_are_several_things_in_a_bin() -> None:
    table, camera = list(room.BOXES[:4]), np.asarray(room.camera().T_robot_cam)[:3, 3]
    towards = (camera[:2] - (0.5, 0.0)) / np.linalg.norm(camera[:2] - (0.5, 0.0))
    stood = [(np.array((0.5, 0.0)) + away * towards, height) for away, height in ((-0.08, 0.14), (0.08, 0.1))]
    things = [((x - 0.03, y - 0.03, 0.0), (x + 0.03, y + 0.03, height)) for (x, y), height in stood]
    boxes = np.array([*table, *things, *BIN])
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.0, boxes)
    grown = cv2.dilate((owner == 4).astype(np.uint8), np.ones((3, 3))) > 0
    assert (grown & (owner == 5)).any()
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), np.zeros(owner.shape, bool)).pixels
    walls = owner >= FIRST
    assert np.count_nonzero(found & walls) > 0.9 * np.count_nonzero(walls) > 1000


def test_walls_that_are_farther_apart_than_those_of_a_box_are_a_bin_with_one_thing() -> None:
    boxes = np.concatenate([room.BOXES[:5], np.array(BIN)])
    frame, _, owner = room.photo(room.camera(width=640, height=480), boxes=boxes)
    found = find_bin_walls(frame, find_table(frame, np.random.default_rng(0)), np.zeros(owner.shape, bool)).pixels
    walls = owner >= 5
    assert np.count_nonzero(found & walls) > 0.9 * np.count_nonzero(walls) > 1000
