"""Tasks through ``gymnasium.make``."""

import importlib
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError

gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

GRS = "grs_agents.envs:GRS-v0"
PICTURES: dict[str, Any] = {"image_size": (24, 32), "renderer": "rays"}
Trace = list[dict[str, np.ndarray]]


def run_actions(env: Any, seed: int, actions: list[np.ndarray]) -> Trace:
    return [env.reset(seed=seed)[0], *(env.step(action)[0] for action in actions)]


def is_same(first: Trace, second: Trace) -> bool:
    return all(np.array_equal(one[key], other[key]) for one, other in zip(first, second, strict=True) for key in one)


@pytest.mark.parametrize("control", ["pick_place", "ee_delta", "joint_position"])
def test_gymnasium_finds_no_fault(blocks, control) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(gymnasium.make(GRS, run=blocks, control=control).unwrapped)


def test_gymnasium_finds_no_fault_in_pictures_and_variations(blocks) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(
            GRS,
            run=blocks,
            cameras=("photo", "wrist"),
            modalities=("rgb", "depth", "masks"),
            variation={"jitter": 0.02},
            **PICTURES,
        )
        env_checker.check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(("control", "count"), [("ee_delta", 30), ("pick_place", 2)])
def test_a_seed_is_one_episode_to_the_bit_alone_after_others_and_in_vectors(blocks, control, count) -> None:
    arguments = {"run": blocks, "control": control, "variation": {"jitter": 0.02, "yaw": 0.5}}
    env = gymnasium.make(GRS, **arguments)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(count)]
    alone = run_actions(env, 7, actions)
    assert not is_same(alone, run_actions(env, 8, actions))
    assert is_same(alone, run_actions(env, 7, actions))
    for mode in ("sync", "async", "vector_entry_point"):
        vector = gymnasium.make_vec(GRS, num_envs=2, vectorization_mode=mode, **arguments)
        both = run_actions(vector, 6, [np.stack([-action, action]) for action in actions])
        vector.close()
        assert is_same(alone, [{key: value[1] for key, value in row.items()} for row in both]), mode


def test_one_pick_and_place_solves_the_task(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks, control="pick_place", normalized=False, reward="sparse")
    observation, info = env.reset(seed=1)
    assert (info["instance"], info["is_success"]) == (1, False)
    assert observation["objects"][0, :2] == pytest.approx((0.45, -0.15), abs=0.002)
    assert observation["targets"][0, :2] == pytest.approx((0.5, 0.15))
    assert observation["open"] == [1]
    observation, reward, terminated, truncated, info = env.step(np.array([0.4, 0.3, 0.3, 0.3, 0.0]))
    assert (reward, terminated, truncated, info["is_success"]) == (0.0, False, False, False)
    assert "nothing to grasp" in info["note"]
    observation, reward, terminated, truncated, info = env.step(np.array([0.45, -0.15, 0.5, 0.15, 0.5]))
    assert (reward, terminated, truncated, info["is_success"]) == (1.0, True, False, True)
    assert (info["strict_score"], info["note"]) == (1.0, "placed")
    assert observation["open"] == [0]


def test_steps_of_the_tip_solve_the_task_only_when_nothing_is_held_any_more(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks, control="ee_delta")
    tip, gained = env.reset(seed=0)[0]["tip"][:3], 0.0

    def go(x: float, y: float, z: float, suction: float, until: str = "") -> tuple[dict[str, np.ndarray], bool]:
        """Lead the tip to a point until it is there, something is held, or the task is solved."""
        nonlocal tip, gained
        for _ in range(60):
            away = np.array([x, y, z]) - tip
            step = np.array([*np.clip(0.4 * away / 0.03, -1, 1), 0.0, suction], dtype=np.float32)
            observation, reward, terminated, _, info = env.step(step)
            tip, gained = observation["tip"][:3], gained + reward
            if terminated or np.abs(away).max() < 0.002 or observation.get(until, 0) == 1:
                return observation, info["is_success"]
        raise AssertionError(f"the tip is at {tip}")

    go(0.5, -0.1, 0.07, -1.0)
    observation, _ = go(0.5, -0.1, 0.03, 1.0, until="suction")
    assert observation["held"] == [1]
    go(0.5, -0.1, 0.15, 1.0)
    go(0.5, 0.15, 0.15, 1.0)
    observation, solved = go(0.5, 0.15, 0.0415, 1.0)
    assert observation["objects"][0, :3] == pytest.approx((0.5, 0.15, 0.02), abs=0.01)
    assert not solved
    assert go(0.5, 0.15, 0.15, -1.0)[1]
    assert 1.5 < gained < 2.0


def test_an_episode_is_cut_off_at_its_horizon(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks, control="joint_position", horizon=3)
    env.reset(seed=0)
    ends = [env.step(np.zeros(7, dtype=np.float32))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_physics_that_diverge_cut_an_episode_off(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks)
    before, _ = env.reset(seed=0)
    env.unwrapped.episode.physics.data.qvel[-1] = 1e12
    observation, _, terminated, truncated, info = env.step(np.zeros(5, dtype=np.float32))
    assert (terminated, truncated, info["strict_score"]) == (False, True, 0.0)
    assert "diverged" in info["error"]
    assert is_same([before], [observation])


def test_seeds_are_instances(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks)
    assert [env.reset(seed=seed)[1]["instance"] for seed in (0, 1, 2, 3, 101)] == [0, 1, 2, 0, 2]
    assert env.reset(options={"instance": 1})[1]["instance"] == 1
    with pytest.raises(InputError, match=r"unknown instance '9'; use one of: 0, 1, 2"):
        env.reset(options={"instance": 9})
    assert gymnasium.make(GRS, run=blocks, seeds=[2]).reset(seed=0)[1]["instance"] == 2


def test_a_varied_episode_differs_from_its_instance_within_bounds(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks, variation={"jitter": 0.03})
    starts = np.array([env.reset(seed=seed, options={"instance": 0})[0]["objects"][0, :2] for seed in range(3)])
    assert np.abs(starts - (0.5, -0.1)).max() < 0.031
    assert len(np.unique(starts, axis=0)) == 3


def test_a_task_that_pushes_has_its_own_primitive(pushes) -> None:
    with pytest.raises(InputError, match=r"control 'pick_place': the task's robot has a spatula; use control='push'"):
        gymnasium.make(GRS, run=pushes, control="pick_place")
    env = gymnasium.make(GRS, run=pushes, control="push", normalized=False)
    env.reset(seed=0)
    _, reward, terminated, _, info = env.step(np.array([0.5, -0.16, 0.5, 0.185]))
    assert (terminated, info["note"]) == (True, "pushed"), info
    assert reward > 1
    moved, _ = gymnasium.make(GRS, run=pushes, control="ee_delta").reset(seed=0)
    assert moved["suction"] == [0]


def test_pictures_show_the_objects(blocks) -> None:
    env = gymnasium.make(GRS, run=blocks, cameras=("photo",), modalities=("rgb", "depth", "masks"), **PICTURES)
    observation, _ = env.reset(seed=0)
    block = observation["photo_masks"] == 1
    assert 3 < block.sum() < 100
    assert observation["photo_depth"][block] == pytest.approx(0.76, abs=0.05)
    assert observation["photo_rgb"].shape == (24, 32, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control": "joints"}, "unknown control 'joints'"),
        ({"cameras": ("top",)}, "unknown camera 'top'"),
        ({"modalities": ("rgbd",)}, "unknown modality 'rgbd'"),
        ({"reward": "shaped"}, "unknown reward 'shaped'"),
        ({"variation": {"shake": 1}}, "use fields"),
        ({"seeds": [7]}, "unknown seed '7'"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused(blocks, arguments, message) -> None:
    with pytest.raises(InputError, match=message):
        gymnasium.make(GRS, run=blocks, **arguments)


@pytest.mark.parametrize("shift", [3, "front", ((0, 0, np.nan), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 0, 0)), ((0, 0, 0),)])
def test_a_camera_shift_that_is_no_pose_is_refused(blocks, shift: object) -> None:
    env = gymnasium.make(GRS, run=blocks)
    with pytest.raises(InputError, match=r'options\["camera"\] = .* is no pose'):
        env.reset(options={"camera": shift})


def test_a_run_that_was_not_accepted_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"status": "rejected"}), encoding="utf-8")
    with pytest.raises(InputError, match="is rejected, not accepted"):
        gymnasium.make(GRS, run=tmp_path)


def test_without_gymnasium_the_error_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "grs_agents.tasks.envs.gym_environment", raising=False)
    with pytest.raises(InputError, match=r"gymnasium is not installed; run: pip install"):
        importlib.import_module("grs_agents.tasks.envs.gym_environment")
