"""Untrusted scenes: a worker decodes their files, and its answer is checked."""

import os
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from grs_agents.base import content
from grs_agents.base.config.schema import CameraConfig
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists
from grs_agents.base.foreign.pictures import MOST_PIXELS
from grs_agents.perception.reading.annotations import LONGEST_NAME
from grs_agents.perception.reading.bop import PREFIX, is_bop_source, parse_bop_source
from grs_agents.perception.reading.captures import find_capture, split_choice
from grs_agents.perception.reading.frame_assembly import MOST_FRAME_PIXELS, SceneRecording
from grs_agents.perception.reading.masks import MOST_MASKS, GivenMasks, find_mask_names, read_masks
from grs_agents.perception.reading.photo_without_depth import Estimator
from grs_agents.perception.reading.picture import ColorPicture
from grs_agents.perception.reading.scene_files import find_files_beside_photo, has_usual_name, list_files
from grs_agents.perception.reading.scene_folder import SCENE_SUFFIXES
from grs_agents.perception.reading.scene_source import check_scene_source, finish_recording, read_scene
from grs_agents.perception.types import Camera, RGBDFrame
from grs_agents.sandbox.host.foreign_reader import ForeignReader, WorkerReply

_WORKER = "grs_agents.perception.reading.worker"
_MOST_LINKS = 1_000
"""Bound on the followed links to files outside a scene's folder."""
_TARGETS = frozenset(SCENE_SUFFIXES)
_HASH = re.compile("[0-9a-f]{30,64}")
"""Name of a file in a content-addressed store (Hugging Face, DVC), a usual target of links in data sets."""


class _Photo(BaseModel):
    """A photo without depth."""

    model_config = ConfigDict(strict=True, extra="forbid")

    file: str = Field(max_length=4096)
    orientation: int = Field(ge=1, le=8)
    focal_35mm: float | None = Field(ge=5, le=1000)


class _Scene(BaseModel):
    """The worker's answer, beside the pixels."""

    model_config = ConfigDict(extra="forbid")

    rows: int = Field(ge=1)
    columns: int = Field(ge=1)
    camera: Camera | None
    notes: tuple[str, ...] = Field(max_length=100)
    photo: _Photo | None


_MASK_NAMES = TypeAdapter(
    Annotated[tuple[Annotated[str, Field(max_length=LONGEST_NAME)], ...], Field(max_length=MOST_MASKS)]
)


def read_foreign_scene(
    source: Path,
    estimate: Estimator | None = None,
    field_of_view: float | None = None,
    camera: CameraConfig | None = None,
) -> RGBDFrame:
    """As `read_scene`, in a worker without keys that can open only the scene; shipped scenes are read in process.

    Raises:
        InputError: as `read_scene`; or reading it takes more memory or time than a scene needs.
    """
    check_scene_source(source)
    if is_sample_scene(source):
        return read_scene(source, estimate, field_of_view, camera)
    home = _find_home(source)
    if is_bop_source(source):
        image = parse_bop_source(source)
        pictures = image.find_picture_file("rgb", "gray"), image.find_picture_file("depth")
        files = [home / "scene_camera.json", *(file for file in pictures if file is not None)]
    elif find_capture(source) is not None:
        files = []  # links that lead out of a capture are not followed
    elif is_folder(split_choice(source)[0]) or find_files_beside_photo(source) is not None:
        paths = [path for path in list_files(home) if path.suffix.lower() in SCENE_SUFFIXES]
        files = [home / path for path in paths if has_usual_name(path)]
    else:
        files = [home / "camera.json"]
    links = _find_linked_files(home, files)
    reading = _read_in_worker(source, {"camera": (camera or CameraConfig()).model_dump()}, links)
    linked = tuple(f"{link} is a link to {target}, outside the scene's folder" for link, target in links.items())
    try:
        scene = _Scene.model_validate(reading.answer)
        pixels = scene.rows * scene.columns
        if pixels > (MOST_FRAME_PIXELS + scene.rows + scene.columns if scene.photo is None else MOST_PIXELS):
            raise ValueError("too many pixels")
        rgb = np.frombuffer(reading.blobs["rgb"], np.uint8).reshape(scene.rows, scene.columns, 3).copy()
        if scene.photo is not None:
            file = Path(_name_as_given(scene.photo.file, source))
            picture = ColorPicture(file, rgb, scene.photo.orientation, scene.photo.focal_35mm)
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
    recording = SceneRecording(source, picture, scene.camera, notes=(*notes, *linked))
    return finish_recording(recording, estimate, field_of_view)


def read_foreign_masks(source: Path, shape: tuple[int, int]) -> GivenMasks:
    """As `read_masks`, in a worker."""
    if is_sample_scene(source):
        return read_masks(source, shape)
    home = _find_home(source)
    files: list[Path] = []  # the masks, and the folders that hold them
    folders: list[Path] = []
    start = ""
    if is_bop_source(source):
        start, folders = f"{parse_bop_source(source).file_stem}_", [home / "mask_visib"]
    elif is_folder(source) or source.suffix.lower() != ".npz":
        files = [home / name for name in find_mask_names(home)]
        folders = [file for file in files if not file.is_symlink()]
    for folder in filter(is_folder, folders):
        files += [folder / name for name in list_folder_names(folder) if name.startswith(start)]
    links = _find_linked_files(home, files)
    reading = _read_in_worker(source, {"shape": list(shape)}, links)
    try:
        labels = np.frombuffer(reading.blobs["labels"], np.int32).reshape(shape).copy()
        names = _MASK_NAMES.validate_python(reading.answer["names"])
    except (ValueError, KeyError) as error:
        raise InputError(f"{source} cannot be read: the worker's answer holds no masks", "try again") from error
    return GivenMasks(np.clip(labels, 0, MOST_MASKS), names)


def _read_in_worker(source: Path, request: dict[str, Any], links: dict[Path, Path]) -> WorkerReply:
    try:
        capture = find_capture(source)
        if is_bop_source(source) or is_folder(split_choice(source)[0]):
            readable = [_find_home(source)]
        elif capture is not None and "shape" not in request:
            readable = [capture.path]
        elif ("shape" in request and source.suffix.lower() != ".npz") or find_files_beside_photo(source) is not None:
            readable = [_find_home(source)]  # the masks or the depth of a photo lie beside it
        else:
            readable = [source]
            if (camera := source.parent / "camera.json").is_file() and camera not in links and not camera.is_symlink():
                readable.append(camera)
        with ForeignReader(_WORKER, [*readable, *links.values()]) as reader:
            return reader.read({**request, "source": str(_absolute(source))}, str(source))
    except InputError as error:
        message, remedy = (_name_as_given(text, source) for text in (error.message, error.remedy))
        raise InputError(message, remedy) from error


def _absolute(source: Path) -> Path:
    """The source by an absolute path: the worker has another working directory."""
    if is_bop_source(source):
        return Path(f"{PREFIX}{Path(str(source).removeprefix(PREFIX)).absolute()}")
    return source.absolute()


def _name_as_given(text: str, source: Path) -> str:
    """A text with file names as the user gave them."""
    given = split_choice(Path(str(source).removeprefix(PREFIX)))[0]
    text = text.replace(str(_absolute(source)), str(source)).replace(str(given.absolute()), str(given))
    return text.replace(f"{given.absolute().parent}/", "" if str(given.parent) == "." else f"{given.parent}/")


def is_sample_scene(source: Path) -> bool:
    """Whether this is a scene of this package or of a ``--content`` folder, which runs as code anyway."""
    if is_bop_source(source):
        return False
    return source.resolve() in {scene.resolve() for scene in content.sample_scenes().values()}


def _find_home(source: Path) -> Path:
    """The folder of a scene, or of its file."""
    if is_bop_source(source):
        return parse_bop_source(source).scene
    path = split_choice(source)[0]
    return path if is_folder(path) else path.parent


def _find_linked_files(folder: Path, files: Iterable[Path]) -> dict[Path, Path]:
    """Targets outside the scene's ``folder`` of the ``files`` that are links.

    Raises:
        InputError: a link leads to a folder or to a file of another kind, which an untrusted scene must not open.
    """
    home = Path(os.path.realpath(folder))
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
