"""What is no object: the robot, what lies behind the base or beyond the workspace."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.coverage import measure_coverage, raised_pixel_mask
from grs_agents.perception.object_finding import (
    SURROUNDINGS,
    find_objects,
    separate_scenery_from_objects,
    unite_mask_with_candidates,
)
from grs_agents.perception.robot_pixels import render_robot_depth, require_joints_within_limits, robot_pixel_mask
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import Candidate, RGBDFrame, TableFrame
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays
from tests.perception import room

HOME = tuple(float(joint) for joint in get_arm().home_joints)


def photo_of_arm(joints: tuple[float, ...] | None) -> tuple[RGBDFrame, np.ndarray]:
    """The room with the arm at home in it, and where the arm is seen, whatever joints the camera tells."""
    camera = room.camera().model_copy(update={"joints": joints})
    frame, _, _ = room.photo(camera)
    pose = np.asarray(camera.T_robot_cam)
    rows, columns = np.indices(frame.depth.shape)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], axis=-1)
    rays = np.asarray(local @ pose[:3, :3].T, np.float64)
    drawn = render_along_rays(VisibleScene((), Library(), np.array(HOME)), pose[:3, 3].copy(), rays)
    on_arm = (drawn.depth > 0) & (pose[2, 3] + drawn.depth * rays[..., 2] > 0.002)
    on_arm &= (drawn.depth < frame.depth) | (frame.depth <= 0)
    depth = np.where(on_arm, drawn.depth, frame.depth).astype(np.float32)
    return RGBDFrame(frame.rgb, depth, camera, Path("arm")), on_arm


def test_the_hand_of_the_run_is_seen_on_the_arm() -> None:
    frame, _ = photo_of_arm(HOME)
    cup, fingers = (render_robot_depth(frame, "ur5e", Library(), hand) for hand in ("suction", "franka_hand"))
    cup, fingers = np.isfinite(cup), np.isfinite(fingers)
    assert (fingers & ~cup).any() and (cup & ~fingers).any()


def test_the_arm_is_seen_where_its_joints_put_it() -> None:
    frame, arm = photo_of_arm(HOME)
    found = robot_pixel_mask(frame, "ur5e", Library())
    assert np.count_nonzero(found & arm) > 0.98 * np.count_nonzero(arm) > 1000
    assert np.count_nonzero(found & ~arm) < 0.3 * np.count_nonzero(arm)
    nearer = RGBDFrame(frame.rgb, np.where(arm, frame.depth - 0.1, frame.depth), frame.camera, frame.source)
    assert np.count_nonzero(robot_pixel_mask(nearer, "ur5e", Library()) & arm) < 0.2 * np.count_nonzero(arm)


def test_without_joints_or_calibration_nothing_is_known_of_the_arm() -> None:
    frame, _ = photo_of_arm(None)
    assert not robot_pixel_mask(frame, "ur5e", Library()).any()
    lost = frame.camera.model_copy(update={"T_robot_cam": None, "joints": HOME})
    assert not robot_pixel_mask(RGBDFrame(frame.rgb, frame.depth, lost, frame.source), "ur5e", Library()).any()


@pytest.mark.parametrize("joints", [HOME[:5], (*HOME, 0.0), (*HOME[:5], 90.0)])
def test_joints_that_the_arm_cannot_have_are_refused(joints: tuple[float, ...]) -> None:
    require_joints_within_limits(HOME, "ur5e")
    with pytest.raises(InputError, match="joint") as caught:
        require_joints_within_limits(joints, "ur5e")
    assert "leave joints out" in caught.value.remedy


@lru_cache(maxsize=1)
def room_photo(boxes: bytes, factor: int) -> tuple[RGBDFrame, np.ndarray]:
    """A photo of so many times 640x480 of these boxes, and the number of the box in each pixel."""
    camera = room.camera(width=640 * factor, height=480 * factor)
    frame, _, owner = room.photo(camera, boxes=np.frombuffer(boxes).reshape(-1, 2, 3))
    return frame, owner


def sorted_out(boxes: np.ndarray, parts: list[tuple[int, ...]], factor: int = 1) -> tuple[list[int], tuple[str, ...]]:
    """Which of the segments, each of some boxes of the room, stay objects in a photo of so many times 640x480; and the
    reasons why others do not."""
    frame, owner = room_photo(boxes.tobytes(), factor)
    table = find_table(frame, np.random.default_rng(0))
    labels = np.zeros(owner.shape, np.int32)
    for number, part in enumerate(parts, 1):
        labels[np.isin(owner, part)] = number
    robot = np.zeros(owner.shape, bool)
    found = separate_scenery_from_objects(measure_candidates(frame, table, labels), robot, frame, table)
    kept = [int(np.bincount(labels[one.mask]).argmax()) for one in found.objects]
    assert [one.id for one in found.objects] == list(range(1, len(kept) + 1))
    assert found.left_out.shape == owner.shape
    assert not any((one.mask & found.left_out).any() for one in found.objects)
    return kept, found.reasons


def with_boxes(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> np.ndarray:
    """The room's boxes and others."""
    return np.concatenate([room.BOXES, np.array(boxes)])


def test_a_thing_that_others_stand_beside_is_an_object() -> None:
    kept, reasons = sorted_out(with_boxes(((0.38, -0.02, 0.0), (0.5, 0.05, 0.05))), [(4,), (5,), (6,)])
    assert (kept, reasons) == ([1, 2, 3], ())


def test_what_lies_beyond_the_workspace_is_no_object() -> None:
    far = ((0.6, 0.76, 0.0), (0.68, 0.84, 0.1))
    kept, reasons = sorted_out(with_boxes(far), [(4,), (5,), (6,)])
    assert kept == [1, 2]
    assert len(reasons) == 1 and "beyond the workspace" in reasons[0]


@pytest.mark.parametrize(("fades", "into_table"), [(True, True), (False, True), (True, False)])
def test_only_a_strip_that_fades_into_the_table_is_the_blurred_edge_of_the_robot(fades: bool, into_table: bool) -> None:
    frame, owner = room_photo(room.BOXES.tobytes(), 1)
    table = find_table(frame, np.random.default_rng(0))
    box = owner == 4
    columns = np.cumsum(box[:, ::-1], axis=1)[:, ::-1]  # of the box, from its right edge on
    strip = box & (columns <= 7)
    depth = frame.depth.copy()
    if fades:  # from not high over the table to where the ray meets it
        height, camera = robot_frame_point_map(frame, table)[..., 2], np.asarray(table.T_robot_cam)[2, 3]
        behind = depth * camera / (camera - height)
        depth = np.where(strip, behind + (depth - behind) * 0.3 * columns / 8, depth).astype(np.float32)
    seen = RGBDFrame(frame.rgb, depth, frame.camera, frame.source)
    labels = strip.astype(np.int32)
    if not into_table:  # but into what is another segment
        labels[(cv2.dilate(labels.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0) & ~box] = 2
    parts = measure_candidates(seen, table, labels)
    found = separate_scenery_from_objects(parts, box & ~strip, seen, table)
    assert len(parts) == labels.max()
    assert any(one.mask[strip].any() for one in found.objects) == (not fades or not into_table)


@pytest.mark.parametrize(("wide", "is_object"), [(3, False), (7, True)])
def test_what_is_thin_and_beside_the_robot_is_its_edge(wide: int, is_object: bool) -> None:
    frame, owner = room_photo(room.BOXES.tobytes(), 1)
    table, box = find_table(frame, np.random.default_rng(0)), owner == 4
    strip = box & (np.cumsum(box[:, ::-1], axis=1)[:, ::-1] <= wide)
    parts = measure_candidates(frame, table, strip.astype(np.int32))
    found = separate_scenery_from_objects(parts, box & ~strip, frame, table)
    assert len(parts) == 1
    assert len(found.objects) == is_object


def test_what_lies_between_a_near_link_and_a_far_one_is_no_robot() -> None:
    frame, arm = photo_of_arm(HOME)
    around = np.ones((9, 9), np.uint8)
    near = cv2.erode(np.where(arm, frame.depth, np.inf).astype(np.float32), around)
    far = cv2.dilate(np.where(arm, frame.depth, 0).astype(np.float32), around)
    between = arm & (far - near > 0.15)
    assert np.count_nonzero(between) > 50
    depth = np.where(between, (near + far) / 2, frame.depth).astype(np.float32)
    found = robot_pixel_mask(RGBDFrame(frame.rgb, depth, frame.camera, frame.source), "ur5e", Library())
    assert np.count_nonzero(found & between) < 0.1 * np.count_nonzero(between)


@pytest.mark.parametrize(("off", "is_object"), [(0.0, True), (0.015, False)])
def test_how_near_to_the_arm_things_are_told_from_it_depends_on_the_calibration(off: float, is_object: bool) -> None:
    frame, arm = photo_of_arm(HOME)
    beside = (cv2.dilate(arm.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~arm
    far = cv2.dilate(np.where(arm, frame.depth, 0).astype(np.float32), np.ones((13, 13), np.uint8))
    depth = np.where(beside, far + 0.02, np.where(arm, frame.depth + off, frame.depth)).astype(np.float32)
    found = robot_pixel_mask(RGBDFrame(frame.rgb, depth, frame.camera, frame.source), "ur5e", Library())
    assert np.count_nonzero(beside) > 200
    assert np.count_nonzero(found & arm) > 0.95 * np.count_nonzero(arm)
    assert (np.count_nonzero(found & beside) < 0.3 * np.count_nonzero(beside)) == is_object


def test_a_hole_in_the_depth_of_the_arm_is_the_robot() -> None:
    frame, owner = room_photo(room.BOXES.tobytes(), 1)
    table = find_table(frame, np.random.default_rng(0))
    parts = measure_candidates(frame, table, np.where(owner == 4, 1, np.where(owner == 5, 2, 0)).astype(np.int32))
    found = separate_scenery_from_objects(parts, owner == 4, frame, table)
    assert len(found.objects) == 1 and "joints" in found.reasons[0]
    assert found.left_out[owner == 4].all() and not found.left_out[owner == 5].any()


LOW_WALL = ((0.75, -1.2, 0.0), (0.8, 1.2, 0.3))


def segment(frame: RGBDFrame, table: TableFrame) -> tuple[Candidate, ...]:
    return measure_candidates(frame, table, segment_objects_on_table(frame, table))


@pytest.mark.parametrize("calibrated", [True, False])
def test_a_wall_behind_the_objects_is_scenery_however_low_it_is(calibrated: bool) -> None:
    frame, owner = room_photo(np.concatenate([room.BOXES[[0, 4, 5]], [LOW_WALL]]).tobytes(), 1)
    if not calibrated:
        frame = replace(frame, camera=frame.camera.model_copy(update={"T_robot_cam": None}))
    table, robot = find_table(frame, np.random.default_rng(0)), np.zeros(owner.shape, bool)
    found = find_objects(frame, table, robot, lambda photo: segment(photo, table))
    assert len(found.objects) == 2 and SURROUNDINGS in found.reasons
    assert np.count_nonzero(found.left_out & (owner == 3)) > 0.9 * np.count_nonzero(owner == 3) > 1000
    owned = unite_mask_with_candidates(robot, found.objects)
    assert measure_coverage(frame, table, raised_pixel_mask(frame, table, found.left_out), owned).share > 0.95


def test_a_patch_of_a_wall_is_no_object() -> None:
    frame, owner = room_photo(np.concatenate([room.BOXES[[0, 4, 5]], [LOW_WALL]]).tobytes(), 1)
    table, nowhere = find_table(frame, np.random.default_rng(0)), np.zeros(owner.shape, bool)
    below_rim = robot_frame_point_map(frame, table)[..., 2] < 0.28
    poster = (owner == 3) & below_rim & (np.abs(np.arange(640) - 100) < 25)
    labels = np.where(poster, 3, np.where(np.isin(owner, (1, 2)), owner, 0)).astype(np.int32)
    parts = measure_candidates(frame, table, labels)
    found = separate_scenery_from_objects(parts, nowhere, frame, table)
    assert len(parts) == 3 and len(found.objects) == 2
    assert found.reasons == (SURROUNDINGS,) and found.left_out[poster].all()


def test_objects_far_beyond_the_simulated_table_are_left_out() -> None:
    far = ((0.5, 1.5, 0.0), (0.6, 1.6, 0.12))
    boxes = np.concatenate([[((-0.2, -0.9, -0.05), (0.95, 3.0, 0.0))], room.BOXES[4:], [far]])
    frame, _, owner = room.photo(room.camera(yaw=0.7, width=640, height=480), boxes=boxes)
    frame = replace(frame, camera=frame.camera.model_copy(update={"T_robot_cam": None}))
    table = find_table(frame, np.random.default_rng(0))
    parts = measure_candidates(frame, table, np.maximum(owner, 0).astype(np.int32))
    nowhere = np.zeros(owner.shape, bool)
    found = separate_scenery_from_objects(parts, nowhere, frame, table)
    assert len(parts) == 3
    assert len(found.objects) == 2 and all("beyond the simulated table" in reason for reason in found.reasons)
