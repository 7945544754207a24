import json
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.envs import GrsEnv
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.dataset import write_dataset
from grs_agents.tasks.demos.production import make_demonstrations
from grs_agents.tasks.demos.types import FORMATS, Demonstration, Format
from grs_agents.tasks.task_folder import open_task_folder
from tests.gantry import GANTRY
from tests.needs import needs
from tests.tasks.demos.block_tasks import ORDER, two_blocks, write_instances


def write(kind: Format, blocks: Path, kept: Path, folder: Path) -> Path:
    work = shutil.copytree(kept, folder / "work")
    order = json.loads((work / "order.json").read_text(encoding="utf-8"))
    write_dataset(AttemptStore(work, order), kind, folder / "out", open_task_folder(blocks))
    return folder / "out"


def middle(one: Demonstration) -> int:
    return one.steps // 2


@needs("pyarrow", "av")
def test_lerobot(blocks: Path, kept: Path, demonstrations: list[Demonstration], tmp_path: Path) -> None:
    av, pq = import_module("av"), import_module("pyarrow.parquet")
    out = write("lerobot", blocks, kept, tmp_path)
    info = json.loads((out / "meta/info.json").read_text(encoding="utf-8"))
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 25, 3)
    frames = pq.read_table(out / "data/chunk-000/file-000.parquet").to_pydict()
    films = {name: feature for name, feature in info["features"].items() if feature["dtype"] == "video"}
    assert set(frames) == set(info["features"]) - set(films)
    assert info["total_frames"] == len(frames["index"]) == sum(one.steps for one in demonstrations)
    episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    with av.open(str(out / "videos/observation.images.front/chunk-000/file-000.mp4")) as film:
        shown = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in film.decode(video=0)]
    for row, one in zip(episodes, demonstrations, strict=True):
        assert (row["grs/attempt"], row["grs/instance_hash"]) == (one.attempt, one.instance_hash)
        for step in (0, middle(one), one.steps - 1):
            at = row["dataset_from_index"] + step
            assert (frames["episode_index"][at], frames["frame_index"][at]) == (row["episode_index"], step)
            np.testing.assert_array_equal(frames["action"][at], one.actions[step])
            agent = [*one.joint_positions[step], one.suction[step], *one.tip[step], *one.commanded_tip[step]]
            np.testing.assert_array_equal(frames["observation.state"][at], np.array(agent, dtype=np.float32))
            task = [one.objects[step].ravel(), one.targets[step].ravel(), one.held[step], one.open[step]]
            np.testing.assert_array_equal(frames["observation.environment_state"][at], np.concatenate(task))
            time, picture = shown[at]
            begin = row["videos/observation.images.front/from_timestamp"]
            assert time == pytest.approx(begin + frames["timestamp"][at], abs=1e-4)
            assert np.abs(picture.astype(float) - one.images["front"][step]).mean() < 12
        assert frames["next.done"][row["dataset_to_index"] - 1]
    statistics = json.loads((out / "meta/stats.json").read_text(encoding="utf-8"))
    assert set(statistics) == set(info["features"])
    np.testing.assert_allclose(statistics["action"]["mean"], np.mean(frames["action"], axis=0), atol=1e-6)
    np.testing.assert_allclose(statistics["action"]["std"], np.std(frames["action"], axis=0), atol=1e-6)
    levels = np.concatenate([one.images["front"][:-1] for one in demonstrations]).reshape(-1, 3) / 255
    told = np.array(statistics["observation.images.front"]["mean"])
    assert told.shape == (3, 1, 1)
    np.testing.assert_allclose(told.ravel(), levels.mean(axis=0), atol=0.02)


@needs("h5py")
def test_robomimic(blocks: Path, kept: Path, demonstrations: list[Demonstration], tmp_path: Path) -> None:
    out = write("robomimic", blocks, kept, tmp_path)
    with import_module("h5py").File(out / "demos.hdf5") as file:
        assert file["data"].attrs["total"] == sum(one.steps for one in demonstrations)
        masks = [name.decode() for mask in ("train", "valid") for name in file["mask"][mask]]
        assert sorted(masks) == ["demo_0", "demo_1", "demo_2"]
        for number, one in enumerate(demonstrations):
            group = file[f"data/demo_{number}"]
            assert group.attrs["instance_hash"] == one.instance_hash
            np.testing.assert_array_equal(group["actions"], one.actions)
            np.testing.assert_array_equal(group["obs/robot0_joint_pos"], one.joint_positions[:-1])
            np.testing.assert_array_equal(group["next_obs/front_image"], one.images["front"][1:])
            assert group["dones"][()].tolist() == [0] * (one.steps - 1) + [1]


@needs("minari")
def test_minari(blocks: Path, kept: Path, demonstrations: list[Demonstration], tmp_path: Path) -> None:
    out = write("minari", blocks, kept, tmp_path)
    data = import_module("minari").MinariDataset(out / "grs/blocks-v0/data")
    assert data.total_episodes == 3
    for episode, one in zip(data.iterate_episodes(), demonstrations, strict=True):
        np.testing.assert_array_equal(episode.actions, one.actions)
        np.testing.assert_array_equal(episode.observations["objects"], one.objects)
        assert episode.observations["wrist"].shape == one.images["wrist"].shape
        assert episode.terminations.tolist() == [False] * (one.steps - 1) + [True]


@needs("pyarrow", "av", "h5py", "minari")
def test_fingers_have_the_keys_of_each_format(
    finger_blocks: Path, kept_fingers: Path, finger_demonstration: Demonstration, tmp_path: Path
) -> None:
    one = finger_demonstration
    lerobot, robomimic, minari = (write(kind, finger_blocks, kept_fingers, tmp_path / kind) for kind in FORMATS)
    assert one.gripper is not None
    features = json.loads((lerobot / "meta/info.json").read_text(encoding="utf-8"))["features"]
    assert features["observation.state"]["names"][-16] == features["action"]["names"][-1] == "gripper"
    frames = import_module("pyarrow.parquet").read_table(lerobot / "data/chunk-000/file-000.parquet").to_pydict()
    np.testing.assert_array_equal(np.array(frames["observation.state"])[:, -16], one.gripper[:-1, 0])
    with import_module("h5py").File(robomimic / "demos.hdf5") as file:
        np.testing.assert_array_equal(file["data/demo_0/next_obs/robot0_gripper_qpos"], one.gripper[1:])
    data = import_module("minari").MinariDataset(minari / "grs/blocks-v0/data")
    (episode,) = data.iterate_episodes()
    np.testing.assert_array_equal(episode.observations["gripper"], one.gripper)
    env = GrsEnv(lerobot, control="joint_position", normalized=False)
    (observation, _), solved = env.reset(options={"instance": 0}), False
    assert set(observation) == set(episode.observations)
    for step, action in enumerate(one.executed_actions, 1):
        observation, _, solved, _, _ = env.step(action)
        assert observation["gripper"] == pytest.approx(one.gripper[step], abs=1e-6)
    assert solved


@pytest.mark.parametrize("kind", ["lerobot", "robomimic", "minari"])
def test_a_data_set_says_what_it_is(kind: Format, blocks: Path, kept: Path, tmp_path: Path, request) -> None:
    for package in {"lerobot": ("pyarrow", "av"), "robomimic": ("h5py",), "minari": ("minari",)}[kind]:
        pytest.importorskip(package)
    told = json.loads((write(kind, blocks, kept, tmp_path) / "grs.json").read_text(encoding="utf-8"))
    assert told["format"] == kind
    assert told["order"]["seed"] == ORDER.seed
    assert {"grs-agents", "mujoco", "numpy", "python"} == set(told["dataset"]["versions"])
    assert [camera["name"] for camera in told["dataset"]["cameras"]] == ["front", "wrist"]
    assert [one["base_seed"] for one in told["episodes"]] == [0, 1, 0]


def read_environment_arguments(kind: Format, out: Path) -> dict[str, Any]:
    """The arguments of the environment that a data set names."""
    if kind == "robomimic":
        with import_module("h5py").File(out / "demos.hdf5") as file:
            named = json.loads(file["data"].attrs["env_args"])
        assert named["env_name"] == "grs_agents.envs:GRS-v0"
        return named["env_kwargs"]
    return import_module("minari").MinariDataset(out / "grs/blocks-v0/data").env_spec.kwargs


FILES = {"robomimic": "demos.hdf5", "minari": "grs/blocks-v0/data/main_data.hdf5"}


@needs("minari", "h5py")
@pytest.mark.parametrize("kind", ["robomimic", "minari"])
def test_the_environment_that_a_data_set_names_acts_as_its_episodes_did(
    kind: Format, blocks: Path, kept: Path, demonstrations: list[Demonstration], tmp_path: Path, monkeypatch
) -> None:
    out = write(kind, blocks, kept, tmp_path)
    monkeypatch.chdir("/")
    if kind == "minari":
        env = import_module("minari").MinariDataset(out / "grs/blocks-v0/data").recover_environment()
    else:
        env = import_module("gymnasium").make("grs_agents.envs:GRS-v0", **read_environment_arguments(kind, out))
    begin, _ = env.reset(options={"instance": 2})
    np.testing.assert_allclose(begin["objects"], demonstrations[2].objects[0], atol=1e-5)
    assert begin["front_rgb"].shape == demonstrations[2].images["front"][0].shape
    assert [env.step(action)[2] for action in demonstrations[2].actions][-1]
    env.close()


@needs("minari", "h5py")
@pytest.mark.parametrize("kind", ["robomimic", "minari"])
@pytest.mark.parametrize("known_by", ["argument", "option", "variable", "current folder", "run"])
def test_the_environment_of_a_moved_data_set_is_found(
    kind: Format, known_by: str, blocks: Path, kept: Path, tmp_path: Path, monkeypatch
) -> None:
    moved = write(kind, blocks, kept, tmp_path).rename(tmp_path / "moved to here")
    arguments = read_environment_arguments(kind, moved)
    monkeypatch.chdir("/")
    monkeypatch.setattr("sys.argv", ["train.py", "--epochs", "3", "\0"])
    with pytest.raises(InputError, match=r"not in .*out, where it was made; give its present folder: run=FOLDER"):
        GrsEnv(**arguments)
    match known_by:
        case "argument":
            monkeypatch.setattr("sys.argv", ["train.py", str(moved / FILES[kind])])
        case "option":
            monkeypatch.setattr("sys.argv", ["train.py", f"--dataset={moved / FILES[kind]}"])
        case "variable":
            monkeypatch.setenv("MINARI_DATASETS_PATH", str(moved))
        case "current folder":
            monkeypatch.chdir(moved)
        case _:
            arguments["run"] = str(moved)
    assert GrsEnv(**arguments).folder.path == moved


@needs("h5py")
def test_another_data_set_in_the_place_of_a_moved_one_is_not_taken(
    blocks: Path, kept: Path, tmp_path: Path, monkeypatch
) -> None:
    out = write("robomimic", blocks, kept, tmp_path)
    arguments = read_environment_arguments("robomimic", out)
    card = json.loads((out / "grs.json").read_text(encoding="utf-8"))
    assert str(tmp_path) not in json.dumps(card)
    (out / "grs.json").write_text(json.dumps({**card, "dataset": {**card["dataset"], "id": "another"}}))
    with pytest.raises(InputError, match="where it was made"):
        GrsEnv(**arguments)
    assert GrsEnv(str(blocks), dataset=arguments["dataset"]).folder.path == blocks  # a task folder that somebody names


@needs("h5py")
def test_a_data_set_has_a_copy_of_an_arm_of_its_own(tmp_path: Path) -> None:
    folder, work = tmp_path / "gantry", tmp_path / "work"
    (folder / "robot").mkdir(parents=True)
    (folder / "robot" / "arm.xml").write_text(GANTRY)
    instance = two_blocks(0).model_copy(update={"robot": "robot/arm.xml"})
    write_instances(folder, instance)
    order = ORDER.model_copy(update={"episodes": 1, "cameras": ()})
    made = make_demonstrations(open_task_folder(folder), order, work, lambda _: None)
    write_dataset(made, "robomimic", tmp_path / "out", open_task_folder(folder))
    shutil.rmtree(folder)
    assert open_task_folder(tmp_path / "out").read_instance(0).robot == str(tmp_path / "out/robot/arm.xml")
