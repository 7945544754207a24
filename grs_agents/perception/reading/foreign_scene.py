"""Scenes that somebody else made: their files are decoded in a worker, and what it answers is checked."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from grs_agents import content
from grs_agents.errors import InputError
from grs_agents.foreign import MOST_PIXELS, is_folder, path_exists
from grs_agents.perception.reading.bop import PREFIX, is_bop_source, parse_bop_source
from grs_agents.perception.reading.frame_assembly import MOST_FRAME_PIXELS, Recording
from grs_agents.perception.reading.masks import MOST_MASKS, Labels, read_masks
from grs_agents.perception.reading.photo_without_depth import Estimator
from grs_agents.perception.reading.picture import Picture
from grs_agents.perception.reading.scene_source import check_scene_source, finish_recording, read_scene
from grs_agents.perception.types import Camera, RGBDFrame
from grs_agents.sandbox import ForeignReader, Reading

_WORKER = "grs_agents.perception.reading.worker"
_MOST_LINKS = 1_000
"""Of a scene's folder: data sets of many images keep them in one."""


class _Photo(BaseModel):
    """A photo without depth."""

    model_config = ConfigDict(strict=True, extra="forbid")

    file: str = Field(max_length=4096)
    orientation: int = Field(ge=1, le=8)
    focal_35mm: float | None = Field(ge=5, le=1000)


class _Scene(BaseModel):
    """What the worker says of the scene, beside its pixels."""

    model_config = ConfigDict(extra="forbid")

    rows: int = Field(ge=1)
    columns: int = Field(ge=1)
    camera: Camera | None
    notes: tuple[str, ...] = Field(max_length=100)
    photo: _Photo | None


def read_foreign_scene(
    source: Path, estimate: Estimator | None = None, field_of_view: float | None = None
) -> RGBDFrame:
    """As `read_scene`, in a worker that holds no keys and can open nothing but the scene; shipped scenes are read here.

    Raises:
        InputError: as `read_scene`; or reading it takes more memory or time than a scene needs.
    """
    check_scene_source(source)
    if _is_shipped(source):
        return read_scene(source, estimate, field_of_view)
    reading = _read_in_worker(source, {})
    try:
        scene = _Scene.model_validate(reading.answer)
        pixels = scene.rows * scene.columns
        if pixels > (MOST_FRAME_PIXELS + scene.rows + scene.columns if scene.photo is None else MOST_PIXELS):
            raise ValueError("too many pixels")
        rgb = np.frombuffer(reading.blobs["rgb"], np.uint8).reshape(scene.rows, scene.columns, 3).copy()
        if scene.photo is not None:
            said = scene.photo
            file = Path(_name_as_given(said.file, source))
            picture = Picture(file, rgb, said.orientation, said.focal_35mm)
        else:
            depth = np.frombuffer(reading.blobs["depth"], np.float32).reshape(scene.rows, scene.columns).copy()
            if scene.camera is None or not (np.isfinite(depth).all() and (depth >= 0).all()):
                raise ValueError("no depth")
            if (scene.camera.height, scene.camera.width) != (scene.rows, scene.columns):
                raise ValueError("a camera of another size")
            notes = tuple(_name_as_given(note[:2_000], source) for note in scene.notes)
            return RGBDFrame(rgb, depth, scene.camera, source, notes)
    except (ValidationError, ValueError, KeyError) as error:
        raise InputError(f"{source} cannot be read: the worker's answer is no scene", "try again") from error
    notes = tuple(_name_as_given(note[:2_000], source) for note in scene.notes)
    return finish_recording(Recording(source, picture, scene.camera, notes=notes), estimate, field_of_view)


def read_foreign_masks(source: Path, shape: tuple[int, int]) -> Labels:
    """As `read_masks`, in a worker."""
    if _is_shipped(source):
        return read_masks(source, shape)
    reading = _read_in_worker(source, {"shape": list(shape)})
    try:
        labels = np.frombuffer(reading.blobs["labels"], np.int32).reshape(shape).copy()
    except (ValueError, KeyError) as error:
        raise InputError(f"{source} cannot be read: the worker's answer holds no masks", "try again") from error
    return np.clip(labels, 0, MOST_MASKS)


def _read_in_worker(source: Path, request: dict[str, Any]) -> Reading:
    try:
        # The masks of a photo are looked for among the names beside it.
        beside = not is_bop_source(source) and not is_folder(source) and source.suffix.lower() != ".npz"
        readable = (source.parent,) if beside and "shape" in request else tuple(_list_readable(source))
        with ForeignReader(readable, [_WORKER]) as reader:
            return reader.read(_WORKER, {**request, "source": str(_absolute(source))}, str(source))
    except InputError as error:
        message, remedy = (_name_as_given(text, source) for text in (error.message, error.remedy))
        raise InputError(message, remedy) from error


def _absolute(source: Path) -> Path:
    """The worker has another folder to work in."""
    if is_bop_source(source):
        return Path(f"{PREFIX}{Path(str(source).removeprefix(PREFIX)).absolute()}")
    return source.absolute()


def _name_as_given(text: str, source: Path) -> str:
    """A text in which files are named as the user named the scene."""
    given = Path(str(source).removeprefix(PREFIX))
    text = text.replace(str(_absolute(source)), str(source)).replace(str(given.absolute()), str(given))
    return text.replace(f"{given.absolute().parent}/", "" if str(given.parent) == "." else f"{given.parent}/")


def _is_shipped(source: Path) -> bool:
    """Whether this is a scene of this package or of a ``--content`` folder, which runs as code anyway."""
    if is_bop_source(source):
        return False
    return source.resolve() in {scene.resolve() for scene in content.sample_scenes().values()}


def _list_readable(source: Path) -> Iterator[Path]:
    """The files and folders that a scene is made of; links among them are followed, as data sets use them."""
    if is_bop_source(source):
        home = parse_bop_source(source).scene
    elif is_folder(source):
        home = source
    else:
        yield from filter(path_exists, (source, source.parent / "camera.json"))
        return
    yield home
    with suppress(OSError):
        links = (entry for entry in sorted(home.rglob("*")) if entry.is_symlink())
        yield from (link.resolve() for link in islice(links, _MOST_LINKS))
