import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion
from grs_agents.sim import hash_instance, parse_instance_json
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.dataset import write_dataset
from grs_agents.tasks.demos.production import make_demonstrations
from grs_agents.tasks.demos.types import DatasetSummary, Demonstration
from grs_agents.tasks.task_folder import open_task_folder
from tests.needs import needs
from tests.tasks.demos.block_tasks import ORDER, two_blocks, write_instances

QUICK = ORDER.model_copy(update={"cameras": ()})


def interrupt_at(count: int):
    def show(made: AttemptStore) -> None:
        if made.count == count:
            raise KeyboardInterrupt

    return show


def summarise(folder: Path, work: Path, out: Path, order=QUICK) -> DatasetSummary:
    task = open_task_folder(folder)
    return write_dataset(make_demonstrations(task, order, work, lambda _: None), "robomimic", out, task)


def test_a_demonstration_says_what_was_observed_and_done(demonstrations: list[Demonstration]) -> None:
    assert [one.attempt for one in demonstrations] == [0, 1, 2]
    assert [one.base_seed for one in demonstrations] == [0, 1, 0]
    for one in demonstrations:
        steps = one.steps
        assert one.actions.shape == (steps, 7)
        assert one.joint_positions.shape == one.joint_velocities.shape == (steps + 1, 6)
        assert one.objects.shape == (steps + 1, 2, 7)
        assert one.images["wrist"].shape == (steps + 1, 16, 24, 3)
        assert one.object_names == ("block/block.urdf#1", "block/block.urdf#2")
        assert one.language == "put block 1 to the left, then put block 2 to the left"
        assert one.strict >= 0.985
        assert one.rewards.sum() == 1
        assert one.suction.any()
        assert set(np.unique(one.actions[:, -1])) == {-1.0, 1.0}
        assert one.instance_hash == hash_instance(parse_instance_json(one.instance))


def test_the_action_is_the_joint_position_that_is_reached_one_step_later(demonstrations: list[Demonstration]) -> None:
    one = demonstrations[0]
    missed = np.abs(one.actions[:, :-1] - one.joint_positions[1:]).max(axis=1)
    assert np.median(missed) < 0.01
    assert missed.max() < 0.05


def test_after_the_step_that_solves_the_task_the_hand_stays_off_and_retreats(
    demonstrations: list[Demonstration],
) -> None:
    for one in demonstrations:
        solved = int(np.argmax(one.rewards))
        assert solved == one.steps - 16
        assert (one.actions[solved:, -1] == -1).all()
        assert not one.suction[solved + 1 :].any()
        assert one.tip[-1, 2] - one.tip[solved, 2] > 0.04  # m


def test_the_commanded_tip_is_the_one_of_the_last_action(demonstrations: list[Demonstration]) -> None:
    one, arm = demonstrations[0], get_arm("ur5e")
    for step in (0, one.steps // 2, one.steps - 1):
        point, rotation = arm.tip_pose(one.executed_actions[step, :-1].astype(np.float64))
        np.testing.assert_allclose(one.commanded_tip[step + 1, :3], point, atol=1e-5)
        np.testing.assert_allclose(one.commanded_tip[step + 1, 3:], matrix_to_quaternion(rotation), atol=1e-5)
    lag = np.linalg.norm(one.commanded_tip[:, :3] - one.tip[:, :3], axis=1)
    assert 0.001 < lag.max() < 0.05  # m


def test_suction_is_on_before_the_cup_touches(demonstrations: list[Demonstration]) -> None:
    one = demonstrations[0]
    taken = np.flatnonzero(one.suction[1:] & ~one.suction[:-1])
    assert len(taken) == 2
    for step in taken:
        assert (one.actions[step - 4 : step + 1, -1] == 1).all()


def test_cameras_say_where_they_are(demonstrations: list[Demonstration]) -> None:
    front, wrist = demonstrations[0].cameras
    assert (front.name, front.frame, wrist.name, wrist.frame) == ("front", "robot", "wrist", "tip")
    assert np.linalg.norm(np.array(wrist.pose)[:3, 3]) < 0.3
    for one in demonstrations:
        assert one.cameras[0] == front
        np.testing.assert_allclose(one.cameras[1].pose, wrist.pose, atol=1e-6)


@needs("gymnasium")
def test_the_environment_gives_to_the_bit_what_was_written(demonstrations: list[Demonstration], tmp_path: Path) -> None:
    from grs_agents.envs import GrsEnv

    (tmp_path / "instances").mkdir()
    for number, one in enumerate(demonstrations):
        (tmp_path / "instances" / f"seed_{number}.json").write_text(one.instance, encoding="utf-8")
    env = GrsEnv(tmp_path, control="joint_position", normalized=False, reward="sparse")
    for number, one in enumerate(demonstrations):
        observation, info = env.reset(options={"instance": number})
        for step, action in enumerate(one.actions):
            for name in ("joint_positions", "joint_velocities", "tip", "commanded_tip", "objects", "targets"):
                np.testing.assert_array_equal(observation[name], getattr(one, name)[step])
            observation, reward, terminated, truncated, info = env.step(action)
            assert (terminated, truncated) == (step >= np.argmax(one.rewards), False)
            assert not reward or terminated
        assert info["is_success"]


def test_what_was_interrupted_goes_on_where_it_stopped(blocks: Path, tmp_path: Path) -> None:
    task = open_task_folder(blocks)
    with pytest.raises(KeyboardInterrupt):
        make_demonstrations(task, QUICK, tmp_path / "work", interrupt_at(1))
    (first,) = (tmp_path / "work").glob("*.npz")
    written = first.stat().st_mtime_ns
    resumed = make_demonstrations(task, QUICK, tmp_path / "work", lambda _: None)
    assert first.stat().st_mtime_ns == written
    at_once = make_demonstrations(task, QUICK, tmp_path / "other", lambda _: None)
    for one, other in zip(resumed.demonstrations(), at_once.demonstrations(), strict=True):
        assert one.instance_hash == other.instance_hash
        np.testing.assert_array_equal(one.actions, other.actions)
        np.testing.assert_array_equal(one.objects, other.objects)


def test_several_processes_make_the_same_demonstrations(
    blocks: Path, demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made = make_demonstrations(open_task_folder(blocks), ORDER, tmp_path / "work", lambda _: None, workers=2)
    assert made.attempts == {0, 1, 2}
    for one, other in zip(made.demonstrations(), demonstrations, strict=True):
        assert asdict(one).keys() == asdict(other).keys()
        for name, value in asdict(one).items():
            np.testing.assert_equal(value, asdict(other)[name], name)


def test_attempts_that_processes_left_out_are_made_before_later_ones_count(
    blocks: Path, kept: Path, tmp_path: Path
) -> None:
    work = shutil.copytree(kept, tmp_path / "work")
    shutil.move(work / "attempt_000002.npz", work / "attempt_000004.npz")
    (work / "attempt_000001.npz").unlink()
    order = ORDER.model_copy(update={"episodes": 2})
    counts: list[int] = []
    made = make_demonstrations(open_task_folder(blocks), order, work, lambda store: counts.append(store.count))
    assert counts == [2, 3]
    assert made.attempts == {0, 1}
    assert [one.attempt for one in made.demonstrations()] == [0, 1]


def test_a_noisy_replay_leaves_the_path_and_is_told_the_way_back(blocks: Path, tmp_path: Path) -> None:
    order = QUICK.model_copy(update={"episodes": 1, "replays": 1})
    made = make_demonstrations(open_task_folder(blocks), order, tmp_path / "work", lambda _: None)
    clean, noisy = made.demonstrations()
    assert clean.instance_hash == noisy.instance_hash
    np.testing.assert_array_equal(clean.executed_actions, clean.actions)
    steps = min(clean.steps, noisy.steps)
    np.testing.assert_array_equal(noisy.actions[:steps], clean.actions[:steps])
    assert (noisy.executed_actions != noisy.actions).any()
    apart = np.linalg.norm(noisy.tip[:steps, :3] - clean.tip[:steps, :3], axis=1)
    taken = int(np.flatnonzero(clean.suction)[0])
    assert apart.max() > 0.005  # m
    assert apart[taken] < 0.004


@needs("gymnasium")
@pytest.mark.parametrize("hand", ["suction", "robotiq_2f85"])
def test_steps_of_the_tip_are_within_their_limits_with_noise_too_and_solve_the_task(tmp_path: Path, hand: str) -> None:
    instance = two_blocks(0)
    if hand != "suction":
        instance = instance.model_copy(update={"robot": "ur5e", "hand": hand})
    folder = write_instances(tmp_path / "blocks", instance)
    order = QUICK.model_copy(update={"episodes": 1, "replays": 1, "control": "ee_delta"})
    made = make_demonstrations(open_task_folder(folder), order, tmp_path / "work", lambda _: None)
    clean, noisy = made.demonstrations()
    for one in (clean, noisy):
        assert one.actions.shape == one.executed_actions.shape == (one.steps, 5)
        for actions in (one.actions, one.executed_actions):
            assert np.abs(actions[:, :4]).max() < 1  # nothing is clipped
        ways = np.diff(one.commanded_tip[:, :3], axis=0)
        np.testing.assert_allclose(ways, 0.03 * one.executed_actions[:, :3], atol=1e-4)
    assert np.abs(clean.actions[:, :3]).max() > 0.5
    away = noisy.commanded_tip[:100, :3] - clean.commanded_tip[:100, :3]
    back = noisy.actions[:100, :3] - clean.actions[:100, :3]
    assert np.linalg.norm(away, axis=1).max() > 0.005  # m
    np.testing.assert_allclose(back, -0.15 * away / 0.03, atol=1e-3)


def test_a_demonstration_says_where_its_objects_are_wanted_and_which_is_held(
    demonstrations: list[Demonstration],
) -> None:
    one = demonstrations[0]
    assert one.targets.shape == (one.steps + 1, 2, 7)
    np.testing.assert_allclose(one.targets[0, :, :2], [(0.5, 0.15), (0.5, 0.25)], atol=1e-6)
    assert one.open[0].tolist() == [1, 1]
    assert one.open[-1].tolist() == [0, 0]
    np.testing.assert_array_equal(one.held.any(axis=1), one.suction)


def test_another_order_does_not_go_on(blocks: Path, tmp_path: Path) -> None:
    AttemptStore(tmp_path, {"seed": 0})
    with pytest.raises(InputError, match="begun otherwise"):
        make_demonstrations(open_task_folder(blocks), QUICK, tmp_path, lambda _: None)


@needs("h5py")
def test_what_the_expert_cannot_do_is_dropped_and_counted(tmp_path: Path) -> None:
    folder = write_instances(tmp_path / "task", two_blocks(0), two_blocks(1, target_x=1.4))
    order = QUICK.model_copy(update={"episodes": 2, "variation": Variation()})
    summary = summarise(folder, tmp_path / "work", tmp_path / "out", order)
    assert (summary.episodes, summary.dropped) == (1, {"expert": 1})
    assert "expert: " in summary.reasons[0]
    assert not (tmp_path / "work").exists()


@needs("h5py")
def test_no_demonstration_at_all_is_an_error_that_says_why(tmp_path: Path) -> None:
    folder = write_instances(tmp_path / "task", two_blocks(0, target_x=1.4))
    order = QUICK.model_copy(update={"episodes": 1, "variation": Variation()})
    with pytest.raises(GrsError, match="none of 1 attempts gave a demonstration: 1 x expert"):
        summarise(folder, tmp_path / "work", tmp_path / "out", order)
    assert not (tmp_path / "out").exists()


def test_more_episodes_than_instances_need_variation(blocks: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2 instances as they are, 3 are wanted"):
        make_demonstrations(
            open_task_folder(blocks), QUICK.model_copy(update={"variation": Variation()}), tmp_path, lambda _: None
        )


def test_a_data_set_has_one_number_of_objects(tmp_path: Path) -> None:
    fewer = two_blocks(1)
    fewer = fewer.model_copy(update={"objects": fewer.objects[:1], "goals": fewer.goals[:1]})
    folder = write_instances(tmp_path / "task", two_blocks(0), fewer)
    with pytest.raises(InputError, match="differ in how many objects"):
        make_demonstrations(open_task_folder(folder), QUICK, tmp_path / "work", lambda _: None)


@needs("h5py")
def test_a_data_set_is_a_task_folder_too(blocks: Path, kept: Path, tmp_path: Path) -> None:
    work = shutil.copytree(kept, tmp_path / "work")
    summarise(blocks, work, tmp_path / "out", ORDER)
    folder = open_task_folder(tmp_path / "out")
    assert folder.seeds == (0, 1, 2)
    assert folder.read_instance(0) == two_blocks(0)


def test_fingers_are_recorded_as_what_they_are_told(finger_demonstration: Demonstration) -> None:
    one = finger_demonstration
    last = one.actions[:, -1]
    assert last.max() == 1.0
    assert ((last > 0) | ((last <= 0) & (last >= -1))).all()
    assert set(np.unique(last)) > {1.0}  # to open, the share of the stroke
    assert -1.0 < last[last <= 0].mean() < 0.0
    assert one.suction.any()
    assert one.strict >= 0.985
    assert one.gripper is not None
    width, held = one.gripper[:, 0], one.suction
    assert width[0] == pytest.approx(0.085, abs=1e-4)
    assert np.ptp(width[held][5:-5]) < 0.001  # on the block
    assert width[held][5:-5].mean() == pytest.approx(0.04, abs=0.003)
