"""An image of a data set in the BOP format (github.com/thodan/bop_toolkit, docs/bop_datasets_format.md)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from grs_agents.errors import InputError
from grs_agents.foreign import exists, is_folder, names_in, read_json
from grs_agents.perception.reading.camera import camera_from_matrix
from grs_agents.perception.reading.frame_assembly import RecordedDepth, Recording
from grs_agents.perception.reading.picture import SUFFIXES, read_color, read_depth_picture

PREFIX = "bop:"
FORM = "bop:ROOT/SPLIT/SCENE/IMAGE, e.g. bop:data/ycbv/test/000048/1"
METRES_PER_MILLIMETRE = 0.001


@dataclass(frozen=True)
class BopImage:
    """One image of a scene folder."""

    scene: Path  # the folder with ``scene_camera.json``
    number: int  # of the image

    @property
    def stem(self) -> str:
        """What its files' names begin with."""
        return f"{self.number:06d}"

    def picture(self, *folders: str) -> Path | None:
        """Its file in the first of these folders that holds one."""
        for folder in folders:
            for suffix in SUFFIXES:
                file = self.scene / folder / f"{self.stem}{suffix}"
                if exists(file):
                    return file
        return None


def is_bop(source: Path) -> bool:
    """Whether ``source`` names an image of a BOP data set."""
    return str(source).startswith(PREFIX)


def bop_image(source: Path) -> BopImage:
    """The image that ``bop:ROOT/SPLIT/SCENE/IMAGE`` names; leading zeros of SCENE and IMAGE may be left out."""
    path = Path(str(source).removeprefix(PREFIX))
    if len(path.parts) < 2 or not (path.name.isascii() and path.name.isdigit()) or len(path.name) > 9:
        raise InputError(f"{source} is not {FORM.split(',', maxsplit=1)[0]}", f"write {FORM}")
    scene, number = path.parent, int(path.name)
    padded = scene.with_name(scene.name.zfill(6)) if scene.name else scene
    for folder in (scene, padded):
        if is_folder(folder):
            return BopImage(folder, number)
    raise InputError(f"{source}: there is no scene folder {scene}", _other_scenes(scene.parent))


def _other_scenes(split: Path) -> str:
    """What to write instead of a scene that a split has not."""
    names = [name for name in names_in(split) if is_folder(split / name)] if is_folder(split) else []
    return f"use one of {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}" if names else f"write {FORM}"


def read_bop(source: Path) -> Recording:
    """Read an image with its camera and, if it has one, its depth."""
    image = bop_image(source)
    file = image.scene / "scene_camera.json"
    entry = image_entry(read_json(file, "name a scene folder of a data set in the BOP format"), image.number, file)
    where = f"{file}, image {image.number}"
    color = image.picture("rgb", "gray")
    if color is None:
        raise InputError(
            f"{source}: {image.scene} holds no rgb/{image.stem} and no gray/{image.stem}", "name another image"
        )
    picture = read_color(color)
    size = (picture.rgb.shape[1], picture.rgb.shape[0])
    depth = image.picture("depth")
    scale = _scale(entry, where) if depth is not None else METRES_PER_MILLIMETRE
    camera = camera_from_matrix(entry.get("cam_K"), size, f"cam_K of {where}", depth_scale=scale)
    if depth is None:
        return Recording(source, picture, camera)
    measured = RecordedDepth(
        read_depth_picture(depth), scale, str(depth), f"depth_scale of {where} (there in millimetres)"
    )
    return Recording(source, picture, camera, measured)


def image_entry(entries: Mapping[str, Any], number: int, file: Path) -> dict[str, Any]:
    """What a file of a BOP scene says of an image."""
    entry = entries.get(str(number))
    if entry is None:
        numbers = sorted(int(key) for key in entries if key.isascii() and key.isdigit() and len(key) < 10)
        known = f"{len(numbers)} from {numbers[0]} to {numbers[-1]}" if numbers else "none"
        raise InputError(f"{file} has no image {number}", f"name one of those it has: {known}")
    if not isinstance(entry, dict):
        raise InputError(f"{file}: image {number} is no object", "get the data set again")
    return cast(dict[str, Any], entry)


def _scale(entry: Mapping[str, Any], where: str) -> float:
    """Metres per unit of depth; the format tells millimetres."""
    given = entry.get("depth_scale")
    if not isinstance(given, int | float) or not 0 < given < 1e6:
        raise InputError(f"depth_scale of {where} is {str(given)[:40]}", "give the millimetres per unit of depth")
    return float(given) * METRES_PER_MILLIMETRE
