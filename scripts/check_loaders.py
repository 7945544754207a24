"""Do LeRobot, robomimic and Minari read what ``grs demos`` writes? ``make`` one data set of each, then ask each loader.

    python -m scripts.check_loaders make RUN FOLDER
    VENV/bin/python scripts/check_loaders.py lerobot FOLDER

The second command needs numpy and the loader alone (``pip install "lerobot[dataset]"``, ``robomimic`` or ``minari``),
in an environment of its own: what they need does not fit together. It compares the first, the middle and the last frame
of three episodes with what was observed.
"""

import argparse
import importlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CAMERAS = ("front", "wrist")
NUMBERS, FILM, JPEG = 1e-6, 6.0, 8.0
"""Largest error of a number, and of a picture's levels (of 255) on average."""
Frame = dict[str, Any]


def make(run: Path, folder: Path, episodes: int) -> None:
    """Write the same demonstrations in each format, and ``expected.npz``."""
    from grs_agents.tasks.demos.dataset import write_dataset
    from grs_agents.tasks.demos.production import DemoOrder, make_demonstrations
    from grs_agents.tasks.demos.types import FORMATS
    from grs_agents.tasks.task_folder import open_task_folder

    task, order = open_task_folder(run), DemoOrder(episodes=episodes, cameras=CAMERAS)
    folder.mkdir(parents=True)
    for kind in FORMATS:
        store = make_demonstrations(task, order, folder / "unfinished", lambda _: None)
        expected: dict[str, Any] = {}
        for number, demonstration in enumerate(store.demonstrations()):
            if number not in (0, episodes // 2, episodes - 1):
                continue
            for step in (0, demonstration.steps // 2, demonstration.steps - 1):
                key = f"{number}/{step}"
                expected |= {f"{key}/images/{name}": images[step] for name, images in demonstration.images.items()}
                expected |= {
                    f"{key}/joint_positions": demonstration.joint_positions[step],
                    f"{key}/objects": demonstration.objects[step],
                    f"{key}/actions": demonstration.actions[step],
                    f"{key}/rewards": demonstration.rewards[step],
                }
        np.savez(folder / "expected.npz", **expected)
        print(write_dataset(store, kind, folder / kind, task).opens_with)


def read_lerobot(folder: Path) -> Callable[[int, int], Frame]:
    """Frames by episode and step, as LeRobot gives them."""
    module = importlib.import_module("lerobot.datasets.lerobot_dataset")
    data: Any = module.LeRobotDataset("grs/check", root=folder / "lerobot", video_backend="pyav")
    begins: list[int] = [int(row["dataset_from_index"]) for row in data.meta.episodes]

    def read(episode: int, step: int) -> Frame:
        row = data[begins[episode] + step]
        assert (int(row["episode_index"]), int(row["frame_index"])) == (episode, step)
        assert row["task"]
        images = {name: row[f"observation.images.{name}"].numpy() for name in CAMERAS}
        action, task = row["action"].numpy(), row["observation.environment_state"].numpy()
        return {
            "joint_positions": row["observation.state"].numpy()[: len(action) - 1],
            "objects": task[: 7 * len(task) // 16].reshape(-1, 7),
            "actions": action,
            "rewards": row["next.reward"].numpy().ravel()[0],
            **{f"images/{name}": 255 * image.transpose(1, 2, 0) for name, image in images.items()},
        }

    chunks = module.LeRobotDataset(
        "grs/check",
        root=folder / "lerobot",
        video_backend="pyav",
        delta_timestamps={"action": [k / 25 for k in range(8)]},
    )
    assert chunks[0]["action"].shape[0] == 8
    print(f"lerobot: {data.num_episodes} episodes, {data.num_frames} frames, {data.fps} fps, {list(data.features)}")
    return read


def read_robomimic(folder: Path) -> Callable[[int, int], Frame]:
    """Frames by episode and step, as robomimic gives them."""
    observations: Any = importlib.import_module("robomimic.utils.obs_utils")
    files: Any = importlib.import_module("robomimic.utils.file_utils")
    dataset: Any = importlib.import_module("robomimic.utils.dataset")
    path = str(folder / "robomimic" / "demos.hdf5")
    low, rgb = ["robot0_joint_pos", "object", "suction"], [f"{name}_image" for name in CAMERAS]
    observations.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": low, "rgb": rgb}})
    print("robomimic:", files.get_env_metadata_from_dataset(path)["env_name"])
    keys = {"obs_keys": (*low, *rgb), "dataset_keys": ("actions", "rewards", "dones"), "hdf5_cache_mode": None}
    data: Any = dataset.SequenceDataset(path, seq_length=1, frame_stack=1, load_next_obs=True, **keys)
    begins: dict[str, int] = {name: int(data._demo_id_to_start_indices[name]) for name in data.demos}

    def read(episode: int, step: int) -> Frame:
        row = data[begins[f"demo_{episode}"] + step]
        seen = {name: values[0] for name, values in row["obs"].items()}
        return {
            "joint_positions": seen["robot0_joint_pos"],
            "objects": seen["object"].reshape(-1, 7),
            "actions": row["actions"][0],
            "rewards": row["rewards"][0],
            **{f"images/{name}": _rows_first(seen[f"{name}_image"]) for name in CAMERAS},
        }

    print(f"robomimic: {data.n_demos} episodes, {len(data)} frames")
    return read


def read_minari(folder: Path) -> Callable[[int, int], Frame]:
    """Frames by episode and step, as Minari gives them."""
    minari: Any = importlib.import_module("minari")
    (path,) = (folder / "minari").glob("grs/*/data")
    data: Any = minari.MinariDataset(path)
    episodes = {int(episode.id): episode for episode in data.iterate_episodes()}

    def read(episode: int, step: int) -> Frame:
        one = episodes[episode]
        seen = {name: values[step] for name, values in one.observations.items()}
        names = ("joint_positions", "objects")
        return {
            **{name: seen[name] for name in names},
            "actions": one.actions[step],
            "rewards": one.rewards[step],
            **{f"images/{name}": seen[name] for name in CAMERAS},
        }

    print(f"minari: {data.total_episodes} episodes, {data.total_steps} steps")
    return read


READERS: dict[str, tuple[Callable[[Path], Callable[[int, int], Frame]], float]] = {
    "lerobot": (read_lerobot, FILM),
    "robomimic": (read_robomimic, 0.0),
    "minari": (read_minari, JPEG),
}
"""Reader of each loader, and the tolerance of its pictures."""


def check(loader: str, folder: Path) -> bool:
    """True if the loader reproduces the observations; prints the deviation."""
    reader, lossy = READERS[loader]
    read, expected = reader(folder), np.load(folder / "expected.npz")
    worst: dict[str, float] = {}
    for key in expected.files:
        episode, step, name = key.split("/", 2)
        loaded = np.asarray(read(int(episode), int(step))[name], dtype=np.float64)
        off = np.abs(loaded - expected[key])
        kind = "pictures" if name.startswith("images/") else "numbers"
        worst[kind] = max(worst.get(kind, 0.0), float(off.mean() if kind == "pictures" else off.max()))
    right = worst["numbers"] <= NUMBERS and worst["pictures"] <= lossy
    version = importlib.import_module("importlib.metadata").version(loader)
    print(json.dumps({"loader": loader, "version": version, "right": right, **worst}))
    return right


def _rows_first(image: Any) -> Any:
    """(H, W, 3) 0..255 of what may be (3, H, W) 0..1."""
    image = np.asarray(image, dtype=np.float64)
    if image.shape[0] == 3:
        image = image.transpose(1, 2, 0)
    return image * 255 if image.max() <= 1 else image


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    maker = verbs.add_parser("make", help="write the data sets and what was observed")
    maker.add_argument("run", type=Path)
    maker.add_argument("folder", type=Path)
    maker.add_argument("--episodes", type=int, default=5)
    for name in READERS:
        verbs.add_parser(name, help=f"read with {name}").add_argument("folder", type=Path)
    given = parser.parse_args()
    if given.verb == "make":
        make(given.run, given.folder, given.episodes)
        return 0
    return 0 if check(given.verb, given.folder) else 1


if __name__ == "__main__":
    sys.exit(main())
