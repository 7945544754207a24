"""An image of a data set in the BOP format (github.com/thodan/bop_toolkit, docs/bop_datasets_format.md)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists, read_json
from grs_agents.perception.reading.camera import camera_from_matrix
from grs_agents.perception.reading.frame_assembly import RecordedDepth, SceneRecording
from grs_agents.perception.reading.picture import SUFFIXES, read_color_picture, read_depth_picture

PREFIX = "bop:"
FORM = "bop:ROOT/SPLIT/SCENE/IMAGE, e.g. bop:data/ycbv/test/000048/1"
METRES_PER_MILLIMETRE = 0.001


@dataclass(frozen=True)
class BopImage:
    """An image of a scene folder."""

    scene: Path  # the folder with ``scene_camera.json``
    number: int  # of the image

    @property
    def file_stem(self) -> str:
        """Common beginning of its files' names."""
        return f"{self.number:06d}"

    def find_picture_file(self, *folders: str) -> Path | None:
        """Its file in the first of these folders that has it."""
        for folder in folders:
            for suffix in SUFFIXES:
                file = self.scene / folder / f"{self.file_stem}{suffix}"
                if path_exists(file):
                    return file
        return None


def is_bop_source(source: Path) -> bool:
    """Whether ``source`` names an image of a BOP data set."""
    return str(source).startswith(PREFIX)


def parse_bop_source(source: Path) -> BopImage:
    """The image that ``bop:ROOT/SPLIT/SCENE/IMAGE`` names; leading zeros of SCENE and IMAGE may be left out."""
    path = Path(str(source).removeprefix(PREFIX))
    if len(path.parts) < 2 or not (path.name.isascii() and path.name.isdigit()) or len(path.name) > 9:
        raise InputError(f"{source} is not {FORM.split(',', maxsplit=1)[0]}", f"write {FORM}")
    scene, number = path.parent, int(path.name)
    for folder in (scene, scene.with_name(scene.name.zfill(6)) if scene.name else scene):
        if is_folder(folder):
            return BopImage(folder, number)
    split = scene.parent
    names = [name for name in list_folder_names(split) if is_folder(split / name)] if is_folder(split) else []
    remedy = f"use one of {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}" if names else f"write {FORM}"
    raise InputError(f"{source}: there is no scene folder {scene}", remedy)


def read_bop_image(source: Path) -> SceneRecording:
    """Read an image with its camera and, if present, its depth."""
    image = parse_bop_source(source)
    file = image.scene / "scene_camera.json"
    entry = find_image_entry(read_json(file, "name a scene folder of a data set in the BOP format"), image.number, file)
    where = f"{file}, image {image.number}"
    color = image.find_picture_file("rgb", "gray")
    if color is None:
        found = f"{source}: {image.scene} holds no rgb/{image.file_stem} and no gray/{image.file_stem}"
        raise InputError(found, "name another image")
    picture = read_color_picture(color)
    size = (picture.rgb.shape[1], picture.rgb.shape[0])
    depth = image.find_picture_file("depth")
    scale = METRES_PER_MILLIMETRE
    if depth is not None:
        stated = entry.get("depth_scale")
        if not isinstance(stated, int | float) or not 0 < stated < 1e6:
            raise InputError(f"depth_scale of {where} is {str(stated)[:40]}", "give the millimetres per unit of depth")
        scale = float(stated) * METRES_PER_MILLIMETRE
    camera = camera_from_matrix(entry.get("cam_K"), size, f"cam_K of {where}", depth_scale=scale)
    if depth is None:
        return SceneRecording(source, picture, camera)
    measured = RecordedDepth(
        read_depth_picture(depth), scale, str(depth), f"depth_scale of {where} (there in millimetres)"
    )
    return SceneRecording(source, picture, camera, measured)


def find_image_entry(entries: Mapping[str, Any], number: int, file: Path) -> dict[str, Any]:
    """The entry of an image in a file of a BOP scene."""
    entry = entries.get(str(number))
    if entry is None:
        numbers = sorted(int(key) for key in entries if key.isascii() and key.isdigit() and len(key) < 10)
        known = f"{len(numbers)} from {numbers[0]} to {numbers[-1]}" if numbers else "none"
        raise InputError(f"{file} has no image {number}", f"name one of those it has: {known}")
    if not isinstance(entry, dict):
        raise InputError(f"{file}: image {number} is no object", "get the data set again")
    return cast(dict[str, Any], entry)
