"""What a scene is read from, told by its name: the one door to all the formats."""

from pathlib import Path

from grs_agents import content
from grs_agents.errors import InputError
from grs_agents.foreign import exists, is_folder
from grs_agents.perception.reading import point_cloud
from grs_agents.perception.reading.archive import read_archive
from grs_agents.perception.reading.bop import PREFIX, bop_image, is_bop, read_bop
from grs_agents.perception.reading.folder import read_folder, with_camera
from grs_agents.perception.reading.frame_assembly import Recording, assemble_frame
from grs_agents.perception.reading.photo_without_depth import Estimator, assemble_frame_of_photo
from grs_agents.perception.reading.picture import SUFFIXES, read_color
from grs_agents.perception.types import RGBDFrame

REMEDY = (
    "name a folder with rgb.png, depth.png and camera.json, bop:ROOT/SPLIT/SCENE/IMAGE, an .npz, or a photo with a "
    "depth tool"
)


def check_source(source: Path) -> None:
    """See that there is something of a known kind under this name, without reading it; raises InputError if not."""
    try:
        str(source).encode()
    except UnicodeEncodeError as error:  # neither the run's record nor its trace could name it
        raise InputError(f"the scene's name {str(source)!a} is not UTF-8", "rename it") from error
    if is_bop(source):
        bop_image(source)
    elif not is_folder(source):
        if not exists(source):
            raise InputError(f"scene {source} does not exist", f"{REMEDY}; samples: {', '.join(content.scenes())}")
        if source.suffix.lower() in point_cloud.SUFFIXES:
            raise InputError(f"{source} is a cloud alone", "put it into a folder with rgb.png and camera.json")
        if source.suffix.lower() not in (".npz", *SUFFIXES):
            raise InputError(f"{source} is no scene", REMEDY)


def resolve_scene(source: Path) -> Path:
    """The scene that a user names: what lies there, else the sample scene of that name."""
    return source if is_bop(source) or exists(source) else content.scenes().get(str(source), source)


def scene_name(source: Path) -> str:
    """A short name for the scene."""
    if is_bop(source):
        return "-".join(Path(str(source).removeprefix(PREFIX)).parts[-4:])
    return source.resolve().stem if not is_folder(source) else source.resolve().name


def read_scene(source: Path, estimate: Estimator | None = None, field_of_view: float | None = None) -> RGBDFrame:
    """Read and check a scene; ``estimate`` makes the depth of a photo without, ``field_of_view`` degrees wide.

    Raises:
        InputError: a file is missing or unreadable, sizes differ in shape, the camera is incomplete or not finite,
            too little was measured, or the depth is in another unit than the camera says.
    """
    check_source(source)
    recording = _recorded(source)
    if recording.measured is not None and recording.camera is not None:
        return assemble_frame(recording, recording.camera, recording.measured)
    if estimate is None:
        raise InputError(f"{recording.picture.file} has no depth", "add depth.png or a point cloud, and camera.json")
    return assemble_frame_of_photo(recording, estimate, field_of_view)


def _recorded(source: Path) -> Recording:
    if is_bop(source):
        return read_bop(source)
    if is_folder(source):
        return read_folder(source)
    if source.suffix.lower() == ".npz":
        return read_archive(source)
    return with_camera(Recording(source, read_color(source)), source.parent / "camera.json")
