"""Store of an unfinished data set's episodes: a file for each attempt, so that an interruption loses little."""

import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib import format as npy
from pydantic import ValidationError

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes, write_json
from grs_agents.base.foreign.arrays import read_npy_stream
from grs_agents.base.foreign.bounded_streams import BoundedReader, check_zip_compression, open_zip
from grs_agents.base.foreign.files import read_json
from grs_agents.tasks.demos.types import CameraModel, Demonstration, Dropped

_ORDER: Final = "order.json"
_ARRAYS: Final = (
    *("joint_positions", "joint_velocities", "tip", "commanded_tip", "suction", "objects", "targets", "held", "open"),
    *("actions", "executed_actions", "rewards", "gripper"),
)
_IMAGE, _CHANGE = "image:", "change:"
"""Prefixes of a camera's pictures: as they are, or of a camera that stands still the differences of successive ones
(modulo 256), which shrink by 17 instead of 2."""
_MOST_DIRECTORY: Final = 1 << 20
"""Most bytes of the directory of an attempt's archive."""
_MOST_HEADER: Final = 1 << 26
_MOST_ARRAY: Final = 1 << 32
"""Most bytes of an array, e.g. the pictures of a camera: 4,600 of 640x480 pixels."""
_LEAST_ROOM, _MOST_RATIO = 1 << 24, 200
"""Bytes that any attempt may unpack to, and largest compression ratio: simulated pictures shrink by 20 at best."""
_ATTEMPT: Final = re.compile(r"attempt_(\d{6,12})")
_REMEDY: Final = "remove it: the attempt is made again"
_TORN: Final = (
    *(zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError),
    *(ValueError, TypeError, LookupError, RecursionError),
)
"""Errors of zipfile, json and numpy on torn or forged files."""


class AttemptStore:
    """The attempts of an order. Raises ``InputError`` for a folder with attempts of another order."""

    def __init__(self, path: Path, order: dict[str, Any]) -> None:
        if path.is_symlink():  # the folder may come from somebody else
            raise InputError(f"{path} is a link", "remove it to begin anew")
        self.path, file = path, path / _ORDER
        self.order: dict[str, Any] = json.loads(json.dumps(order))  # settings that all attempts depend on
        order = self.order
        if not file.is_file():
            write_json(file, order)
        elif (begun := read_json(file, "remove that folder to begin anew")) != order:
            changed = sorted(key for key in {*begun, *order} if begun.get(key) != order.get(key))
            raise InputError(
                f"{path} holds episodes that were begun otherwise: {', '.join(changed)}",
                "give the same options to go on, or remove that folder to begin anew",
            )

    @cached_property
    def _kept_attempt_files(self) -> dict[int, Path]:
        return self._find_attempt_files("npz")

    @cached_property
    def _rejected_attempt_files(self) -> dict[int, Path]:
        return self._find_attempt_files("json")

    def _find_attempt_files(self, kind: str) -> dict[int, Path]:
        files = {_ATTEMPT.fullmatch(file.stem): file for file in sorted(self.path.glob(f"attempt_*.{kind}"))}
        return {int(name[1]): file for name, file in files.items() if name and not file.is_symlink()}

    @property
    def attempts(self) -> frozenset[int]:
        """Numbers of the attempts that were made."""
        return frozenset(self._kept_attempt_files) | frozenset(self._rejected_attempt_files)

    @property
    def count(self) -> int:
        """Number of demonstrations."""
        return len(self._kept_attempt_files)

    def find_end(self, total: int) -> int | None:
        """Number after that of the attempt that completes ``total`` demonstrations; None while any before it waits."""
        kept = sorted(self._kept_attempt_files)
        if len(kept) < total:
            return None
        end = kept[total - 1] + 1
        return end if sum(attempt < end for attempt in self.attempts) == end else None

    def remove_from(self, end: int | None) -> None:
        """Remove the attempts from number ``end`` on; none for None."""
        for files in (self._kept_attempt_files, self._rejected_attempt_files):
            for attempt in [] if end is None else [number for number in files if number >= end]:
                files.pop(attempt).unlink()

    def note(self, file: Path) -> None:
        """Note the file of an attempt that another store of the folder wrote."""
        files = self._kept_attempt_files if file.suffix == ".npz" else self._rejected_attempt_files
        files[int(file.stem.removeprefix("attempt_"))] = file

    def add(self, attempt: int, result: Demonstration | Dropped) -> Path:
        """Write the result of an attempt, whole or not at all; returns its file."""
        if isinstance(result, Dropped):
            file = write_json(self._attempt_file(attempt, "json"), result.model_dump(), durable=True)
        else:
            arrays: dict[str, Any] = {
                name: getattr(result, name) for name in _ARRAYS if getattr(result, name) is not None
            }
            for camera in result.cameras:
                images = result.images[camera.name]
                if camera.frame == "robot":
                    arrays[_CHANGE + camera.name] = np.diff(images, axis=0, prepend=np.uint8(0))
                else:
                    arrays[_IMAGE + camera.name] = images
            names = [part.name for part in fields(result) if part.name not in (*_ARRAYS, "images", "cameras")]
            header: dict[str, Any] = {name: getattr(result, name) for name in names}
            header["cameras"] = [camera.model_dump() for camera in result.cameras]
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
                archive.writestr("header.json", json.dumps(header))
                for name, array in arrays.items():
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                        npy.write_array(entry, np.ascontiguousarray(array), allow_pickle=False)
            file = write_bytes(self._attempt_file(attempt, "npz"), buffer.getvalue(), durable=True)
        self.note(file)
        return file

    def _attempt_file(self, attempt: int, kind: str) -> Path:
        return self.path / f"attempt_{attempt:06d}.{kind}"

    def demonstrations(self) -> Iterator[Demonstration]:
        """The demonstrations in the order of the attempts, read one at a time.

        Raises ``InputError`` for a file that is torn, forged, or unpacks to more than pictures shrink by.
        """
        for _, file in sorted(self._kept_attempt_files.items()):
            try:
                demonstration = _read_demonstration(file)
            except _TORN as error:
                reason = str(error)[:200] or type(error).__name__
                raise InputError(f"{file} is no whole attempt: {reason}", _REMEDY) from error
            yield demonstration

    def read_dropped_attempts(self) -> list[Dropped]:
        """Attempts without a demonstration, in their order."""
        dropped: list[Dropped] = []
        for _, file in sorted(self._rejected_attempt_files.items()):
            try:
                dropped.append(Dropped.model_validate(read_json(file, _REMEDY)))
            except ValidationError as error:
                raise InputError(f"{file} is no attempt: {error.errors()[0]['msg']}", _REMEDY) from error
        return dropped


def _read_demonstration(path: Path) -> Demonstration:
    left = max(_LEAST_ROOM, _MOST_RATIO * path.stat().st_size)
    with path.open("rb") as packed, open_zip(packed, str(path), _MOST_DIRECTORY) as file:
        for member in file.infolist():
            check_zip_compression(member, str(path))
        with file.open("header.json") as content:
            header: dict[str, Any] = json.loads(BoundedReader(content, str(path), _MOST_HEADER).read())
        names = [name.removesuffix(".npy") for name in file.namelist() if name.endswith(".npy")]
        arrays: dict[str, Any] = {}
        for name in names:
            with file.open(f"{name}.npy") as content:
                arrays[name] = read_npy_stream(content, f"{name} in {path}", min(_MOST_ARRAY, left))
            left -= arrays[name].nbytes
    images = {name.removeprefix(_IMAGE): arrays.pop(name) for name in names if name.startswith(_IMAGE)}
    for name in [name for name in names if name.startswith(_CHANGE)]:
        images[name.removeprefix(_CHANGE)] = np.cumsum(arrays.pop(name), axis=0, dtype=np.uint8)
    header["cameras"] = tuple(CameraModel.model_validate(camera) for camera in header["cameras"])
    for name in ("object_names", "joint_names"):
        header[name] = tuple(header[name])
    return Demonstration(**header, **arrays, images=images)
