"""Scenes that somebody else made: their files are decoded in a worker, and what it answers is checked."""

import os
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists
from grs_agents.base.foreign.pictures import MOST_PIXELS
from grs_agents.perception.reading import point_cloud
from grs_agents.perception.reading.bop import PREFIX, is_bop_source, parse_bop_source
from grs_agents.perception.reading.frame_assembly import MOST_FRAME_PIXELS, Recording
from grs_agents.perception.reading.masks import MOST_MASKS, STEMS, Labels, read_masks
from grs_agents.perception.reading.photo_without_depth import Estimator
from grs_agents.perception.reading.picture import SUFFIXES, Picture
from grs_agents.perception.reading.scene_folder import is_scene_file_name
from grs_agents.perception.reading.scene_source import check_scene_source, finish_recording, read_scene
from grs_agents.perception.types import Camera, RGBDFrame
from grs_agents.sandbox.host.foreign_reader import ForeignReader, Reading

_WORKER = "grs_agents.perception.reading.worker"
_MOST_LINKS = 1_000
"""Links to files outside a scene's folder that are followed."""
_TARGETS = frozenset((*SUFFIXES, *point_cloud.SUFFIXES, ".npz", ".json"))
_HASH = re.compile("[0-9a-f]{30,64}")
"""Name of a file in a store by content (Hugging Face, DVC), to which the folders of data sets link."""


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
    links = _find_linked_files(source, _list_scene_files(source))
    reading = _read_in_worker(source, {}, links)
    linked = tuple(f"{link} is a link to {target}, outside the scene's folder" for link, target in links.items())
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
            return RGBDFrame(rgb, depth, scene.camera, source, (*notes, *linked))
    except (ValidationError, ValueError, KeyError) as error:
        raise InputError(f"{source} cannot be read: the worker's answer is no scene", "try again") from error
    notes = tuple(_name_as_given(note[:2_000], source) for note in scene.notes)
    recording = Recording(source, picture, scene.camera, notes=(*notes, *linked))
    return finish_recording(recording, estimate, field_of_view)


def read_foreign_masks(source: Path, shape: tuple[int, int]) -> Labels:
    """As `read_masks`, in a worker."""
    if _is_shipped(source):
        return read_masks(source, shape)
    links = _find_linked_files(source, _list_mask_files(source))
    reading = _read_in_worker(source, {"shape": list(shape)}, links)
    try:
        labels = np.frombuffer(reading.blobs["labels"], np.int32).reshape(shape).copy()
    except (ValueError, KeyError) as error:
        raise InputError(f"{source} cannot be read: the worker's answer holds no masks", "try again") from error
    return np.clip(labels, 0, MOST_MASKS)


def _read_in_worker(source: Path, request: dict[str, Any], links: dict[Path, Path]) -> Reading:
    try:
        if is_bop_source(source) or is_folder(source):
            readable = [_find_home(source)]
        elif "shape" in request and source.suffix.lower() != ".npz":
            readable = [source.parent]  # among whose names the masks of a photo are looked for
        else:
            readable = [source]
            if (camera := source.parent / "camera.json").is_file() and camera not in links and not camera.is_symlink():
                readable.append(camera)
        with ForeignReader([*readable, *links.values()], [_WORKER]) as reader:
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


def _find_home(source: Path) -> Path:
    """The folder of a scene; that in which its file lies."""
    if is_bop_source(source):
        return parse_bop_source(source).scene
    return source if is_folder(source) else source.parent


def _list_scene_files(source: Path) -> Iterator[Path]:
    """The files that a scene may be read from, links among them, without a file that the user named."""
    home = _find_home(source)
    if is_bop_source(source):
        image = parse_bop_source(source)
        yield home / "scene_camera.json"
        yield from filter(None, (image.find_picture_file("rgb", "gray"), image.find_picture_file("depth")))
    elif is_folder(source):
        yield from (home / name for name in list_folder_names(home) if is_scene_file_name(name))
    else:
        yield home / "camera.json"


def _list_mask_files(source: Path) -> Iterator[Path]:
    """The files that the masks of a scene may be read from, and the folders that hold them."""
    home = _find_home(source)
    if is_bop_source(source):
        start, folders = f"{parse_bop_source(source).file_stem}_", [home / "mask_visib"]
    elif not is_folder(source) and source.suffix.lower() == ".npz":
        return
    else:
        found = [home / name for name in list_folder_names(home) if Path(name).stem.lower() in STEMS]
        yield from found
        start, folders = "", [file for file in found if not file.is_symlink()]
    for folder in filter(is_folder, folders):
        yield from (folder / name for name in list_folder_names(folder) if name.startswith(start))


def _find_linked_files(source: Path, files: Iterator[Path]) -> dict[Path, Path]:
    """The files outside the scene's folder that ``files`` lead to, by link.

    Raises:
        InputError: a link leads to a folder or to a file of another kind: a stranger's scene opens no more than it is.
    """
    home = Path(os.path.realpath(_find_home(source)))
    links: dict[Path, Path] = {}
    for file in files:
        target = Path(os.path.realpath(file))
        if target.is_relative_to(home) or not path_exists(target):
            continue
        try:
            regular = target.is_file()
        except OSError:
            regular = False
        if not regular or not (target.suffix.lower() in _TARGETS or _HASH.fullmatch(target.name)):
            raise InputError(f"{file} is a link to {target}, which is no file of a scene", "copy the file there")
        links[file] = target
    return dict(islice(links.items(), _MOST_LINKS))
