import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sim import utils

angle = st.floats(-3.0, 3.0)
tilt = st.floats(-1.4, 1.4)
metre = st.floats(-2, 2)


@given(angle, tilt, angle)
def test_euler_angles_survive_the_way_through_quaternions(roll: float, pitch: float, yaw: float) -> None:
    back = utils.quatXYZW_to_eulerXYZ(utils.eulerXYZ_to_quatXYZW((roll, pitch, yaw)))
    np.testing.assert_allclose(back, (roll, pitch, yaw), atol=1e-6)


@given(st.tuples(metre, metre, metre), st.tuples(angle, tilt, angle), st.tuples(metre, metre, metre))
def test_a_pose_times_its_inverse_leaves_points_alone(position, rotation, point) -> None:
    pose = (position, utils.eulerXYZ_to_quatXYZW(rotation))
    both = utils.multiply(pose, utils.invert(pose))
    np.testing.assert_allclose(utils.apply(both, point), point, atol=1e-9)


def test_apply_transforms_many_points_at_once() -> None:
    pose = ((1.0, 0.0, 0.0), utils.eulerXYZ_to_quatXYZW((0, 0, np.pi / 2)))
    np.testing.assert_allclose(utils.apply(pose, np.eye(3)), [[1, 0, 1], [1, 0, 0], [0, 0, 1]], atol=1e-12)


@given(st.integers(0, 6))
def test_the_moves_of_hanoi_bring_each_disk_on_a_larger_one_to_the_last_rod(disks: int) -> None:
    rods: list[list[int]] = [list(range(disks))[::-1], [], []]
    moves = utils.solve_hanoi_all(disks)
    for disk, source, target in moves:
        assert rods[source].pop() == disk
        assert not rods[target] or rods[target][-1] > disk
        rods[target].append(disk)
    assert len(rods[2]) == disks
    assert len(moves) == 2**disks - 1


@given(st.tuples(*[st.floats(0.02, 0.4)] * 3), st.floats(0.03, 0.1), st.floats(0, 0.02))
def test_a_cut_box_is_boxes_apart_that_none_can_be_halved(size, smallest: float, margin: float) -> None:
    boxes: list[np.ndarray] = []
    utils.KDTree(utils.TreeNode(None, [], np.array((0.0, 0.0, 0.0, *size))), smallest, margin, boxes)
    low, high = np.split(np.array(boxes).reshape(-1, 6), 2, axis=1)
    assert (low >= 0).all()
    assert (high <= np.asarray(size)).all()
    assert (high - low <= 2 * smallest).all()
    gaps = (np.maximum(low[:, None], low) - np.minimum(high[:, None], high)).max(axis=2)
    assert (gaps[~np.eye(len(gaps), dtype=bool)] >= margin - 1e-9).all()


def test_colours_need_no_mode_and_the_scanned_objects_have_names() -> None:
    assert utils.get_colors()[1] == utils.TRAIN_COLORS
    assert utils.get_random_color()[1][0] in utils.TRAIN_COLORS
    assert not set(utils.google_seen_obj_shapes["train"]) & set(utils.google_unseen_obj_shapes["test"])
    assert len(utils.google_all_shapes["val"]) == 56
