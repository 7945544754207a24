"""LeRobot data sets, version 3.0: parquet files for numbers, mp4 files for pictures, written without LeRobot."""

import json
from collections.abc import Iterable, Sequence
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_json
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.tasks.demos.types import CameraModel, DatasetCard, Demonstration
from grs_agents.tasks.envs.state import AGENT_STATE, TASK_STATE

_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_EPISODES: Final = "meta/episodes/chunk-000/file-000.parquet"
_FILES_PER_CHUNK: Final = 1000
_DATA_MB, _VIDEO_MB = 100, 200
"""Size (MB) beyond which a file is closed and the next begun."""
_CODEC: Final = {"crf": "18", "preset": "veryfast", "g": "2", "threads": "1"}
"""Every second frame is a key frame, for fast random access."""
_INDICES: Final = ("frame_index", "episode_index", "index", "task_index")

Statistics = dict[str, FloatArray]
"""A feature's statistics as in LeRobot: ``min``, ``max``, ``mean``, ``std``, ``q01`` to ``q99``, ``count`` (1,)."""
_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_TASK_INDEX: Final = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}
        for name, kind, numpy_kind in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
    "pandas_version": "2.2.0",
}
"""Metadata of pandas for a table whose index is the task's sentence."""
_SAMPLED: Final = 20
"""Number of pictures of an episode sampled for its statistics."""


def write_lerobot(demonstrations: Iterable[Demonstration], card: DatasetCard, folder: Path) -> None:
    """Write a data set into an empty folder; its pictures have an even number of rows and columns.

    Each frame has ``observation.state`` (``AGENT_STATE``), ``observation.velocity``,
    ``observation.environment_state`` (``TASK_STATE``), ``observation.images.<camera>``, ``action``,
    ``executed_action``, ``next.reward``, ``next.done`` and ``next.success``.
    """
    writer = _Writer(card, folder)
    for demonstration in demonstrations:
        writer.add(demonstration)
    writer.finish()


class _Writer:
    """Writer of a data set, episode by episode."""

    def __init__(self, card: DatasetCard, folder: Path) -> None:
        self._card, self._folder = card, folder
        self._features = _describe_features(card)
        self._data = _ParquetFiles(folder)
        self._videos = {_image_key(camera): _VideoFiles(folder, camera, card.rate) for camera in card.cameras}
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, Statistics]] = []
        self._frames = 0

    def add(self, demonstration: Demonstration) -> None:
        """Write an episode."""
        number, steps = len(self._episodes), demonstration.steps
        task = self._tasks.setdefault(demonstration.language, len(self._tasks))
        last = np.arange(steps) == steps - 1

        def join_columns(names: Sequence[str]) -> npt.NDArray[np.float32]:
            parts = [np.asarray(getattr(demonstration, name), dtype=np.float32)[:-1] for name in names]
            return np.concatenate([part.reshape(steps, -1) for part in parts], axis=1)

        columns: dict[str, npt.NDArray[Any]] = {
            "observation.state": join_columns(
                [name for name in AGENT_STATE if name != "gripper" or self._card.gripper]
            ),
            "observation.velocity": demonstration.joint_velocities[:-1],
            "observation.environment_state": join_columns(TASK_STATE),
            "action": demonstration.actions,
            "executed_action": demonstration.executed_actions,
            "next.reward": demonstration.rewards,
            "next.done": last,
            "next.success": last,
            "timestamp": (np.arange(steps) / self._card.rate).astype(np.float32),
            "frame_index": np.arange(steps),
            "episode_index": np.full(steps, number),
            "index": self._frames + np.arange(steps),
            "task_index": np.full(steps, task),
        }
        statistics = {name: measure_rows(rows) for name, rows in columns.items()}
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [demonstration.language],
            "length": steps,
            **self._data.add(columns),
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + steps,
        }
        for camera in self._card.cameras:
            key, images = _image_key(camera), demonstration.images[camera.name][:-1]
            row |= self._videos[key].add(images)
            statistics[key] = measure_images(images)
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= {"grs/attempt": demonstration.attempt, "grs/base_seed": demonstration.base_seed}
        row |= {"grs/instance_hash": demonstration.instance_hash, "grs/strict_score": demonstration.strict}
        row |= {
            f"stats/{name}/{kind}": value.tolist()
            for name, values in statistics.items()
            for kind, value in values.items()
        }
        self._episodes.append(row)
        self._statistics.append(statistics)
        self._frames += steps

    def finish(self) -> None:
        """Write the metadata of all episodes."""
        pa, pq = _import_pyarrow()

        self._data.close()
        for video in self._videos.values():
            video.close()
        path = self._folder / _EPISODES
        path.parent.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self._episodes), path)
        sentences = list(self._tasks)
        table = pa.table({"task_index": pa.array(range(len(sentences)), pa.int64()), "task": sentences})
        table = table.replace_schema_metadata({"pandas": json.dumps(_TASK_INDEX)})
        pq.write_table(table, self._folder / "meta/tasks.parquet")
        pooled = {name: pool([part[name] for part in self._statistics]) for name in self._statistics[0]}
        as_lists = {name: {kind: value.tolist() for kind, value in part.items()} for name, part in pooled.items()}
        write_json(self._folder / "meta/stats.json", as_lists)
        info: dict[str, Any] = {
            "codebase_version": "v3.0",
            "robot_type": self._card.robot,
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": _FILES_PER_CHUNK,
            "data_files_size_in_mb": _DATA_MB,
            "video_files_size_in_mb": _VIDEO_MB,
            "fps": round(self._card.rate),
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": _DATA,
            "video_path": _VIDEO if self._videos else None,
            "features": self._features,
        }
        write_json(self._folder / "meta/info.json", info)


def _import_pyarrow() -> tuple[Any, Any]:
    """pyarrow and its module for parquet files, both untyped."""
    return import_module("pyarrow"), import_module("pyarrow.parquet")


def _image_key(camera: CameraModel) -> str:
    return f"observation.images.{camera.name}"


def _describe_features(card: DatasetCard) -> dict[str, Any]:
    def describe_vector_feature(names: list[str]) -> dict[str, Any]:
        return {"dtype": "float32", "shape": [len(names)], "names": names}

    def describe_scalar_feature(kind: str) -> dict[str, Any]:
        return {"dtype": kind, "shape": [1], "names": None}

    joints = list(card.joint_names)
    objects = [name.replace("/", ":") for name in card.object_names]

    def name_pose(name: str) -> list[str]:
        return [f"{name}.{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]

    task = [column for name in objects for column in name_pose(name)]
    task += [column for name in objects for column in name_pose(f"{name}.target")]
    task += [f"{name}.{flag}" for flag in ("held", "open") for name in objects]
    width = ["gripper"] if card.gripper else []
    agent = [*joints, *width, "suction", *name_pose("tip"), *name_pose("commanded_tip")]
    features = {
        "observation.state": describe_vector_feature(agent),
        "observation.velocity": describe_vector_feature(joints),
        "observation.environment_state": describe_vector_feature(task),
        "action": describe_vector_feature(list(card.action_names)),
        "executed_action": describe_vector_feature(list(card.action_names)),
        "next.reward": describe_scalar_feature("float32"),
        "next.done": describe_scalar_feature("bool"),
        "next.success": describe_scalar_feature("bool"),
        "timestamp": describe_scalar_feature("float32"),
    }
    for camera in card.cameras:
        info = {
            "video.height": camera.height,
            "video.width": camera.width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": round(card.rate),
            "video.channels": 3,
            "has_audio": False,
        }
        features[_image_key(camera)] = {
            "dtype": "video",
            "shape": [camera.height, camera.width, 3],
            "names": ["height", "width", "channels"],
            "info": info,
        }
    return features | {name: describe_scalar_feature("int64") for name in _INDICES}


def _next_file_index(files: int) -> dict[str, int]:
    """Chunk and index of the next file after a number of files."""
    return {"chunk_index": files // _FILES_PER_CHUNK, "file_index": files % _FILES_PER_CHUNK}


class _ParquetFiles:
    """Parquet files of frames, a row group for each episode."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._files = folder, 0
        self._writer: Any = None
        self._path = folder

    def add(self, columns: dict[str, npt.NDArray[Any]]) -> dict[str, int]:
        """Write the frames of an episode; returns chunk and index of their file."""
        pa, pq = _import_pyarrow()

        arrays = {
            name: pa.FixedSizeListArray.from_arrays(pa.array(rows.ravel()), rows.shape[1])
            if rows.ndim == 2
            else pa.array(rows)
            for name, rows in columns.items()
        }
        table, place = pa.table(arrays), _next_file_index(self._files)
        if self._writer is None:
            self._path = self._folder / _DATA.format(**place)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(self._path, table.schema)
        self._writer.write_table(table)
        if self._path.stat().st_size > _DATA_MB << 20:
            self.close()
        return {f"data/{name}": value for name, value in place.items()}

    def close(self) -> None:
        """Close the file; the next episode begins a new file."""
        if self._writer is not None:
            self._writer.close()
            self._writer, self._files = None, self._files + 1


class _VideoFiles:
    """Video files of a camera, episode after episode."""

    def __init__(self, folder: Path, camera: CameraModel, rate: float) -> None:
        self._folder, self._camera, self._rate = folder, camera, round(rate)
        self._key, self._files, self._frames = _image_key(camera), 0, 0
        self._container: Any = None
        self._stream: Any = None
        self._path = folder

    def add(self, images: npt.NDArray[np.uint8]) -> dict[str, Any]:
        """Write the pictures (T, H, W, 3) of an episode; returns file and times."""
        av: Any = import_module("av")
        place, begin = _next_file_index(self._files), self._frames
        if self._container is None:
            self._path = self._folder / _VIDEO.format(video_key=self._key, **place)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._container = av.open(str(self._path), "w")
            self._stream = self._container.add_stream("libx264", rate=self._rate, options=_CODEC)
            self._stream.width, self._stream.height = self._camera.width, self._camera.height
            self._stream.pix_fmt = "yuv420p"
        for image in images:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            frame.pts, frame.time_base = self._frames, Fraction(1, self._rate)
            self._container.mux(self._stream.encode(frame))
            self._frames += 1
        times = {"from_timestamp": begin / self._rate, "to_timestamp": self._frames / self._rate}
        if self._path.stat().st_size > _VIDEO_MB << 20:
            self.close()
        return {f"videos/{self._key}/{name}": value for name, value in {**place, **times}.items()}

    def close(self) -> None:
        """Close the file; the next episode begins a new file."""
        container, self._container = self._container, None
        if container is not None:
            container.mux(self._stream.encode())
            container.close()
            self._files, self._frames = self._files + 1, 0


def measure_rows(rows: npt.NDArray[Any]) -> Statistics:
    """Statistics of the columns of rows (T, D) or (T,)."""
    values = np.asarray(rows, dtype=np.float64).reshape(len(rows), -1)
    statistics: Statistics = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
    }
    return statistics | dict(zip(_QUANTILES, np.quantile(values, [*_QUANTILES.values()], axis=0), strict=True))


def measure_images(images: npt.NDArray[np.uint8]) -> Statistics:
    """Statistics of the channels of pictures (T, H, W, 3), scaled to 0..1, each (3, 1, 1)."""
    sample = images[:: max(1, len(images) // _SAMPLED)]
    levels = np.arange(256) / 255
    counts = np.stack([np.bincount(sample[..., channel].ravel(), minlength=256) for channel in range(3)])
    shares = counts / counts.sum(axis=1, keepdims=True)
    total, present = shares.cumsum(axis=1), counts > 0
    mean = shares @ levels
    statistics: Statistics = {
        "min": levels[present.argmax(axis=1)],
        "max": levels[255 - present[:, ::-1].argmax(axis=1)],
        "mean": mean,
        "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(axis=1)),
    }
    statistics |= {name: levels[(total >= share).argmax(axis=1)] for name, share in _QUANTILES.items()}
    return {name: value.reshape(3, 1, 1) for name, value in statistics.items()} | {"count": np.array([len(images)])}


def pool(parts: Sequence[Statistics]) -> Statistics:
    """Statistics of all episodes; quantiles are means weighted by length, as LeRobot pools them."""
    count = np.array([part["count"][0] for part in parts], dtype=np.float64)
    weights = (count / count.sum()).reshape(-1, *[1] * parts[0]["mean"].ndim)
    stacked = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    mean = (weights * stacked["mean"]).sum(axis=0)
    spread = stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2
    statistics: Statistics = {
        "min": stacked["min"].min(axis=0),
        "max": stacked["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt((weights * spread).sum(axis=0)),
        "count": np.array([int(count.sum())]),
    }
    return statistics | {name: (weights * stacked[name]).sum(axis=0) for name in _QUANTILES}
