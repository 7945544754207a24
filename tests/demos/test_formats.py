import json
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from grs_agents.demos import AttemptStore, Demonstration, Format, write_dataset
from grs_agents.task_folder import open_task_folder
from tests.demos.block_tasks import ORDER
from tests.needs import needs


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
            np.testing.assert_array_equal(frames["observation.state"][at][:6], one.joint_positions[step])
            np.testing.assert_array_equal(frames["observation.environment_state"][at], one.objects[step].ravel())
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
        assert json.loads(file["data"].attrs["env_args"])["env_kwargs"]["control"] == "joint_position"
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
