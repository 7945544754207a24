"""Scene sources: dispatch to the reader of each format by name."""

import re
from pathlib import Path

from grs_agents.base import content
from grs_agents.base.config.schema import CameraConfig
from grs_agents.base.errors import InputError, suggest_name
from grs_agents.base.foreign.files import is_folder, path_exists
from grs_agents.perception.reading import point_cloud
from grs_agents.perception.reading.bop import PREFIX, is_bop_source, parse_bop_source, read_bop_image
from grs_agents.perception.reading.captures import find_capture, split_choice
from grs_agents.perception.reading.frame_assembly import SceneRecording, assemble_frame
from grs_agents.perception.reading.npz_archive import read_npz_archive
from grs_agents.perception.reading.photo_without_depth import Estimator, assemble_frame_from_photo
from grs_agents.perception.reading.picture import SUFFIXES, read_color_picture
from grs_agents.perception.reading.scene_files import find_files_beside_photo
from grs_agents.perception.reading.scene_folder import (
    add_camera_to_recording,
    read_scene_files,
    read_scene_folder,
)
from grs_agents.perception.reading.unread_formats import make_unread_format_error
from grs_agents.perception.types import RGBDFrame

REMEDY = (
    "name a folder with a photo, its depth and its camera (FOLDER:NAME if it holds several), "
    "bop:ROOT/SPLIT/SCENE/IMAGE, an .npz, a recording, or a photo with a depth tool"
)


def check_scene_source(source: Path) -> None:
    """Check that a source of a known format exists, without reading it; raises InputError if not."""
    try:
        str(source).encode()
    except UnicodeEncodeError as error:  # neither the run's record nor its trace could name it
        raise InputError(f"the scene's name {str(source)!a} is not UTF-8", "rename it") from error
    if is_bop_source(source):
        parse_bop_source(source)
    elif find_capture(source) is None and not is_folder(split_choice(source)[0]):
        if not path_exists(source):
            samples = content.sample_scenes()
            remedy = f"{suggest_name(str(source), samples)}{REMEDY}; samples: {', '.join(samples)}"
            raise InputError(f"scene {source} does not exist", remedy)
        if source.suffix.lower() in point_cloud.SUFFIXES:
            raise InputError(f"{source} is a cloud alone", "put it into a folder with rgb.png and camera.json")
        if source.suffix.lower() not in (".npz", *SUFFIXES):
            raise make_unread_format_error(source) or InputError(f"{source} is no scene", REMEDY)


def resolve_scene_path(source: Path) -> Path:
    """The scene that a user names: an existing path, else the sample scene of that name."""
    named = is_bop_source(source) or path_exists(split_choice(source)[0])
    return source if named else content.sample_scenes().get(str(source), source)


def short_scene_name(source: Path) -> str:
    """A short name for the scene."""
    if is_bop_source(source):
        return "-".join(Path(str(source).removeprefix(PREFIX)).parts[-4:])
    path, choice = split_choice(source)
    path = path.resolve()
    name = path.name if is_folder(path) else path.stem
    return "-".join(part for part in (name, *re.findall(r"[\w.]+", choice)) if part)


def read_scene(
    source: Path,
    estimate: Estimator | None = None,
    field_of_view: float | None = None,
    camera: CameraConfig | None = None,
) -> RGBDFrame:
    """Read and check a scene.

    Args:
        source: folder (with ``:NAME`` if it holds several pictures), archive, photo or ``bop:`` image.
        estimate: depth tool for a photo without depth.
        field_of_view: horizontal, degrees, of a photo without depth.
        camera: the user's statements on the camera, which prevail over the scene's files.

    Raises:
        InputError: a file is missing or unreadable, sizes differ in shape, the camera is incomplete or not finite, too
            little was measured, or the depth is in another unit than the camera says.
    """
    return finish_recording(read_recording(source, camera), estimate, field_of_view)


def finish_recording(recording: SceneRecording, estimate: Estimator | None, field_of_view: float | None) -> RGBDFrame:
    """The frame of a recording of `read_recording`; errors as `read_scene`."""
    if recording.measured is not None and recording.camera is not None:
        return assemble_frame(recording, recording.camera, recording.measured)
    if estimate is None:
        raise InputError(f"{recording.picture.file} has no depth", "add depth.png or a point cloud, and camera.json")
    return assemble_frame_from_photo(recording, estimate, field_of_view)


def read_recording(source: Path, camera: CameraConfig | None = None) -> SceneRecording:
    """The decoded files of a scene. Raises InputError as `read_scene`, for faults of a single file."""
    check_scene_source(source)
    capture = find_capture(source)
    own_camera = is_bop_source(source) or capture is not None or source.suffix.lower() == ".npz"
    if own_camera and camera not in (None, CameraConfig()):
        remedy = "leave out --camera, --depth-scale and camera.*, which are for folders and photos"
        raise InputError(f"{source} states its camera itself", remedy)
    if is_bop_source(source):
        return read_bop_image(source)
    if capture is not None:
        return capture.read()
    folder, choice = split_choice(source)
    if is_folder(folder):
        return read_scene_folder(folder, choice, camera)
    if source.suffix.lower() == ".npz":
        return read_npz_archive(source)
    files = find_files_beside_photo(source)
    if files is not None:
        return read_scene_files(source, source.parent, files, camera or CameraConfig())
    recording = SceneRecording(source, read_color_picture(source))
    return add_camera_to_recording(recording, source.parent / "camera.json", camera or CameraConfig())
