"""LeRobot data sets, version 3.0: parquet files for numbers, mp4 files for pictures, without LeRobot itself."""

import json
from collections.abc import Iterable
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_json
from grs_agents.tasks.demos.lerobot_statistics import Statistics, measure_images, measure_rows, pool
from grs_agents.tasks.demos.types import CameraModel, DatasetCard, Demonstration

_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_EPISODES: Final = "meta/episodes/chunk-000/file-000.parquet"
_FILES_PER_CHUNK: Final = 1000
_DATA_MB, _VIDEO_MB = 100, 200
"""A file that has grown beyond so many MB is the last of its kind with that number."""
_CODEC: Final = {"crf": "18", "preset": "veryfast", "g": "2", "threads": "1"}
"""Every second frame is a key frame, so that a reader finds any of them at once."""
_INDICES: Final = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(demonstrations: Iterable[Demonstration], card: DatasetCard, folder: Path) -> None:
    """Write a data set into an empty folder; its pictures have an even number of rows and columns.

    Each frame has ``observation.state`` (joint positions, whether something is held, the tip's position),
    ``observation.velocity``, ``observation.environment_state`` (objects' poses), ``observation.images.<camera>``,
    ``action``, ``next.reward``, ``next.done`` and ``next.success``.
    """
    writer = _Writer(card, folder)
    for demonstration in demonstrations:
        writer.add(demonstration)
    writer.finish()


class _Writer:
    """Writes episode by episode."""

    def __init__(self, card: DatasetCard, folder: Path) -> None:
        self._card, self._folder = card, folder
        self._describe_features = _describe_features(card)
        self._data = _ParquetFiles(folder)
        self._videos = {_image_key(camera): _VideoFiles(folder, camera, card.rate) for camera in card.cameras}
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, Statistics]] = []
        self._frames = 0

    def add(self, demonstration: Demonstration) -> None:
        """Write one episode."""
        number, steps = len(self._episodes), demonstration.steps
        task = self._tasks.setdefault(demonstration.language, len(self._tasks))
        columns = _make_step_columns(demonstration) | {
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
            for name, found in statistics.items()
            for kind, value in found.items()
        }
        self._episodes.append(row)
        self._statistics.append(statistics)
        self._frames += steps

    def finish(self) -> None:
        """Write what is said of all episodes."""
        pa, pq = _import_pyarrow()

        self._data.close()
        for video in self._videos.values():
            video.close()
        path = self._folder / _EPISODES
        path.parent.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self._episodes), path)
        _write_tasks(list(self._tasks), self._folder / "meta/tasks.parquet")
        pooled = {name: pool([part[name] for part in self._statistics]) for name in self._statistics[0]}
        as_lists = {name: {kind: value.tolist() for kind, value in one.items()} for name, one in pooled.items()}
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
            "features": self._describe_features,
        }
        write_json(self._folder / "meta/info.json", info)


def _import_pyarrow() -> tuple[Any, Any]:
    """pyarrow, whose types are not told, and its part for parquet files."""
    return import_module("pyarrow"), import_module("pyarrow.parquet")


def _image_key(camera: CameraModel) -> str:
    return f"observation.images.{camera.name}"


def _make_step_columns(demonstration: Demonstration) -> dict[str, npt.NDArray[Any]]:
    """What each step is: the observation before it, its action, what came of it."""
    steps = demonstration.steps
    last = np.arange(steps) == steps - 1
    held = demonstration.suction[:, None].astype(np.float32)
    state = np.concatenate([demonstration.joint_positions, held, demonstration.tip[:, :3]], axis=1)
    return {
        "observation.state": state[:-1],
        "observation.velocity": demonstration.joint_velocities[:-1],
        "observation.environment_state": demonstration.objects[:-1].reshape(steps, -1),
        "action": demonstration.actions,
        "next.reward": demonstration.rewards,
        "next.done": last,
        "next.success": last,
    }


def _describe_features(card: DatasetCard) -> dict[str, Any]:
    def describe_vector_feature(names: list[str]) -> dict[str, Any]:
        return {"dtype": "float32", "shape": [len(names)], "names": names}

    def describe_scalar_feature(kind: str) -> dict[str, Any]:
        return {"dtype": kind, "shape": [1], "names": None}

    joints = list(card.joint_names)
    poses = [f"{name}.{part}" for name in card.object_names for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    features = {
        "observation.state": describe_vector_feature([*joints, "suction", "tip.x", "tip.y", "tip.z"]),
        "observation.velocity": describe_vector_feature(joints),
        "observation.environment_state": describe_vector_feature([name.replace("/", ":") for name in poses]),
        "action": describe_vector_feature([*joints, "suction"]),
        "next.reward": describe_scalar_feature("float32"),
        "next.done": describe_scalar_feature("bool"),
        "next.success": describe_scalar_feature("bool"),
        "timestamp": describe_scalar_feature("float32"),
    }
    features |= {_image_key(camera): _video_feature(camera, card.rate) for camera in card.cameras}
    return features | {name: describe_scalar_feature("int64") for name in _INDICES}


def _video_feature(camera: CameraModel, rate: float) -> dict[str, Any]:
    info = {
        "video.height": camera.height,
        "video.width": camera.width,
        "video.codec": "h264",
        "video.pix_fmt": "yuv420p",
        "video.is_depth_map": False,
        "video.fps": round(rate),
        "video.channels": 3,
        "has_audio": False,
    }
    shape = [camera.height, camera.width, 3]
    return {"dtype": "video", "shape": shape, "names": ["height", "width", "channels"], "info": info}


def _next_file_index(files: int) -> dict[str, int]:
    """Where the file lies that comes after so many others."""
    return {"chunk_index": files // _FILES_PER_CHUNK, "file_index": files % _FILES_PER_CHUNK}


class _ParquetFiles:
    """Files of frames, one row group an episode."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._files = folder, 0
        self._writer: Any = None
        self._path = folder

    def add(self, columns: dict[str, npt.NDArray[Any]]) -> dict[str, int]:
        """Write the frames of an episode; returns where they are."""
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
        """End the file; the next episode begins another."""
        if self._writer is not None:
            self._writer.close()
            self._writer, self._files = None, self._files + 1


class _VideoFiles:
    """Films of one camera, episode after episode."""

    def __init__(self, folder: Path, camera: CameraModel, rate: float) -> None:
        self._folder, self._camera, self._rate = folder, camera, round(rate)
        self._key, self._files, self._frames = _image_key(camera), 0, 0
        self._container: Any = None
        self._stream: Any = None
        self._path = folder

    def add(self, images: npt.NDArray[np.uint8]) -> dict[str, Any]:
        """Write the pictures (T, H, W, 3) of an episode; returns where they are."""
        av: Any = import_module("av")
        place, begin = _next_file_index(self._files), self._frames
        container = self._container or self._open_video_container(place)
        for image in images:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            frame.pts, frame.time_base = self._frames, Fraction(1, self._rate)
            container.mux(self._stream.encode(frame))
            self._frames += 1
        times = {"from_timestamp": begin / self._rate, "to_timestamp": self._frames / self._rate}
        if self._path.stat().st_size > _VIDEO_MB << 20:
            self.close()
        return {f"videos/{self._key}/{name}": value for name, value in {**place, **times}.items()}

    def _open_video_container(self, place: dict[str, int]) -> Any:
        av: Any = import_module("av")
        self._path = self._folder / _VIDEO.format(video_key=self._key, **place)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._container = av.open(str(self._path), "w")
        self._stream = self._container.add_stream("libx264", rate=self._rate, options=_CODEC)
        self._stream.width, self._stream.height = self._camera.width, self._camera.height
        self._stream.pix_fmt = "yuv420p"
        return self._container

    def close(self) -> None:
        """End the film; the next episode begins another."""
        container, self._container = self._container, None
        if container is not None:
            container.mux(self._stream.encode())
            container.close()
            self._files, self._frames = self._files + 1, 0


def _write_tasks(tasks: list[str], path: Path) -> None:
    """As pandas writes a table whose index is the task's sentence."""
    pa, pq = _import_pyarrow()

    def describe_column(name: str, kind: str, numpy_kind: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}

    told = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [describe_column("task_index", "int64", "int64"), describe_column("task", "unicode", "object")],
        "pandas_version": "2.2.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": tasks})
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(told)}), path)
