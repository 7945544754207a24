"""Reading Wavefront OBJ with its MTL. Faults of materials cost the material and are noted; only the triangles are
required. Polygons become fans; negative indices count back from the current line; several MTL files and materials are
read."""

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.textures import build_mesh_part, color_to_uint8, read_picture_or_note
from grs_agents.library.importing.types import Floats, Image, ImportLimits, MeshPart, RefusedError

_MTL_BYTES: Final = 4_000_000
"""Largest total size of the MTL files of an OBJ file."""
_MTL_LINE: Final = 4_096
"""Characters of a line of an MTL file, or of a line that names MTL files."""
_NAMES: Final = 1_000
"""Largest numbers of MTL files and of pictures searched for an OBJ file: each may cost many look-ups."""
_LINE: Final = 1_000_000
_NOTES: Final = 8
"""Faults of a look that are noted; a file may have thousands."""
_NUMBER: Final = r"\s+[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?"
_OPTION: Final = re.compile(
    rf"-(?:(?P<key>[ost])(?P<numbers>(?:{_NUMBER}(?=\s)){{1,3}})|mm\s+\S+\s+\S+"
    r"|(?:blendu|blendv|cc|clamp|texres|bm|boost|imfchan|type|colorspace)\s+\S+)\s+(?=\S)",
    re.IGNORECASE,
)
"""An option of a map, before the file name."""
_MAPS: Final = ("map_kd", "map_ka")
"""Pictures of the colour; exporters that write the second alone mean the first."""
_OPAQUE: Final = 0.95
_FAR: Final = 1e6
"""Beyond it texture coordinates have no digits left."""


@dataclass
class ObjMaterial:
    """The look of a part, as an MTL file says."""

    color: tuple[float, ...] | None = None  # red, green, blue in 0..1
    picture: str | None = None  # file, relative to the source folder
    scale: tuple[float, float] = (1.0, 1.0)  # of the texture coordinates
    offset: tuple[float, float] = (0.0, 0.0)  # of the texture coordinates
    rank: int = len(_MAPS)  # of the map that the picture is from, in ``_MAPS``


def find_obj_material_files(folder: SourceFolder, obj: str) -> list[str]:
    """The MTL files and pictures that an OBJ file names and that exist, relative to the folder."""
    names: list[str] = []
    with folder.resolve_file(obj).open(encoding="utf-8", errors="replace") as lines:
        while line := lines.readline(_LINE):
            if line.lstrip().startswith("mtllib"):
                names.append(line.split(None, 1)[-1].strip())
    materials, files = _read_materials(folder, obj, names, [])
    return sorted({*files, *(material.picture for material in materials.values() if material.picture)})


def read_obj(
    folder: SourceFolder, name: str, limits: ImportLimits, picture: Image | None
) -> tuple[list[MeshPart], list[str]]:
    """Read the parts of an OBJ file, a part for each material, and the faults of their materials.

    Args:
        picture: (H, W, 3) of all parts, in the place of the pictures that the file names.

    Raises:
        RefusedError: it has no sound triangles, or too many.
    """
    text = folder.resolve_file(name).read_bytes().decode("utf-8", errors="replace").replace("\r", "\n")
    mesh = _ObjText(text.replace("\\\n", " "), name, limits)
    notes: list[str] = []
    materials, _ = _read_materials(folder, name, mesh.libraries, notes) if picture is None else ({}, [])
    pictures: dict[str, Image | None] = {}
    parts: list[MeshPart] = []
    for material_name, part in mesh.iterate_parts():
        material = materials.get(material_name, ObjMaterial())
        if material_name and materials and material_name not in materials:
            notes.append(f"no MTL file describes the material {material_name[:60]!r}")
        image, uvs, colors = picture, part.uvs, part.colors
        if material.picture is not None:
            if material.picture not in pictures:
                path = folder.resolve_file(material.picture)
                pictures[material.picture] = read_picture_or_note(path, limits.pixels, notes)
            image = pictures[material.picture]
            uvs = None if uvs is None else uvs * material.scale + material.offset
        if colors is None and material.color is not None:
            colors = np.tile(color_to_uint8(material.color), (len(part.faces), 1))
        parts.append(build_mesh_part(part.vertices, part.faces, uvs, image, colors, name, notes))
    notes = list(dict.fromkeys(notes))
    left_out = len(notes) - _NOTES
    return parts, notes[:_NOTES] + ([f"{left_out} more faults of the look"] if left_out > 0 else [])


class _ObjText:
    """The numbers of an OBJ file."""

    def __init__(self, text: str, name: str, limits: ImportLimits) -> None:
        self.libraries: list[str] = []
        self._name = name
        points, point_colors, uvs = array("d"), array("d"), array("d")
        # Vertices and texture coordinates of the corners by material and by whether all corners have both.
        self._groups: dict[tuple[str, bool], tuple[array[int], array[int]]] = {}
        material, faces = "", 0
        for number, line in enumerate(text.split("\n"), 1):
            if len(line) > _LINE:
                raise RefusedError(f"{name}, line {number} has {len(line)} characters", "export it again")
            words = line.split()
            key = words[0] if words else ""
            try:
                if key == "v":
                    points.extend((float(words[1]), float(words[2]), float(words[3])))
                    if len(words) >= 7:
                        point_colors.extend((float(words[4]), float(words[5]), float(words[6])))
                elif key == "vt":
                    uvs.extend((float(words[1]), float(words[2]) if len(words) > 2 else 0.0))
                elif key in ("f", "fo"):
                    corners = [_parse_corner(word, len(points) // 3, len(uvs) // 2) for word in words[1:]]
                    faces += max(0, len(corners) - 2)
                    if faces > limits.faces:
                        raise RefusedError(f"{name} has more than {limits.faces} faces", "simplify it")
                    textured = all(second >= 0 for _, second in corners)
                    firsts, seconds = self._groups.setdefault((material, textured), (array("q"), array("q")))
                    for index in range(1, len(corners) - 1):
                        for first, second in (corners[0], corners[index], corners[index + 1]):
                            firsts.append(first)
                            seconds.append(second)
                elif key == "usemtl":
                    material = line.split(None, 1)[1].strip() if len(words) > 1 else ""
                elif key == "mtllib" and len(words) > 1:
                    self.libraries.append(line.split(None, 1)[1].strip())
            except (ValueError, IndexError) as error:
                raise RefusedError(f"{name}, line {number} is {line[:60]!r}: {error}", "export it again") from error
        self._points: Floats = np.array(points, np.float64).reshape(-1, 3)
        self._uvs: Floats = np.array(uvs, np.float64).reshape(-1, 2)
        self._point_colors: Floats = np.array(point_colors, np.float64).reshape(-1, 3)

    def iterate_parts(self) -> Iterator[tuple[str, MeshPart]]:
        """The triangles of each material, without its look."""
        scale = 1.0 if self._point_colors.max(initial=0.0) > 1 else 255.0
        for (material, textured), (firsts, seconds) in self._groups.items():
            corners = np.array(firsts, np.int64).reshape(-1, 3)
            if not len(corners):
                continue
            if corners.max() >= len(self._points):
                message = f"{self._name}: a face names vertex {corners.max() + 1} of {len(self._points)}"
                raise RefusedError(message, "export it again")
            used, faces = np.unique(corners, return_inverse=True)
            if not np.isfinite(self._points[used]).all():
                message = f"{self._name} has vertices that are not finite numbers (NaN or infinity)"
                raise RefusedError(message, "export it again")
            uvs: Floats | None = None
            numbers = np.array(seconds, np.int64).reshape(-1, 3)
            if textured and numbers.max() < len(self._uvs) and np.isfinite(self._uvs[numbers]).all():
                uvs = self._uvs[numbers]
            colors: Image | None = None
            if len(self._point_colors) == len(self._points):
                mean = np.nan_to_num(self._point_colors[corners].mean(axis=1) * scale)
                colors = np.clip(np.rint(mean), 0, 255).astype(np.uint8)
            yield material, MeshPart(self._points[used], faces.reshape(-1, 3), uvs, None, colors)


def _parse_corner(word: str, points: int, uvs: int) -> tuple[int, int]:
    """The vertex and the texture coordinate of a corner, from 0; -1 without texture coordinate."""
    first, _, rest = word.partition("/")
    second = rest.partition("/")[0]
    index, other_index = int(first), int(second) if second else 0
    index = index - 1 if index > 0 else points + index if index < 0 else -1
    if index < 0:
        raise ValueError(f"a face names vertex {first} of {points}")
    return index, other_index - 1 if other_index > 0 else uvs + other_index if other_index < 0 else -1


def _read_materials(
    folder: SourceFolder, obj: str, names: list[str], notes: list[str]
) -> tuple[dict[str, ObjMaterial], list[str]]:
    """Materials by name, and their files: those that the OBJ file names, else the file of its own name with the suffix
    ``.mtl``."""
    paths: list[Path] = []
    for name in list(dict.fromkeys(name for name in names if len(name) <= _MTL_LINE))[:_NAMES]:
        whole = folder.search_file(name, obj)
        words = dict.fromkeys(name.split()) if whole is None else ()
        several = [path for word in words if (path := folder.search_file(word, obj))]
        paths += several if whole is None else [whole]
    if not paths and (path := folder.search_file(PurePosixPath(obj).with_suffix(".mtl").name, obj)):
        paths = [path]
    if names and not paths:
        notes.append(f"its MTL file {names[0][:120]!r} is not in the source: its look is not known")
    materials: dict[str, ObjMaterial] = {}
    room, maps = _MTL_BYTES, dict[tuple[str, str], _Map | None]()
    for path in dict.fromkeys(paths):
        room -= path.stat().st_size
        if room < 0:
            notes.append(f"{path.name} has more than {_MTL_BYTES} bytes: its look is not read")
            continue
        materials |= _read_mtl(folder, folder.relative_file_name(path), maps, notes)
    return materials, [folder.relative_file_name(path) for path in paths]


_Map = tuple[str, tuple[float, float], tuple[float, float]]
"""The picture of a map relative to the source folder, its scale and its offset."""


def _read_mtl(
    folder: SourceFolder, mtl: str, maps: dict[tuple[str, str], _Map | None], notes: list[str]
) -> dict[str, ObjMaterial]:
    """The materials of an MTL file by name; pictures that do not exist are noted. Maps are looked up in ``maps`` by
    file and words, at most `_NAMES` in all."""
    materials: dict[str, ObjMaterial] = {}
    material = ObjMaterial()
    for line in (folder.root / mtl).read_text("utf-8", errors="replace").splitlines():
        if len(line) > _MTL_LINE:
            notes.append(f"{PurePosixPath(mtl).name}: a line of {len(line)} characters is passed over")
            continue
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        key, rest = key.lower(), rest.strip()
        if key == "newmtl":
            material = materials[rest] = ObjMaterial()
        elif key == "kd":
            try:
                numbers = tuple(float(word) for word in rest.split()[:3])
            except ValueError:
                continue  # a spectral curve or CIE XYZ
            material.color = numbers * 3 if len(numbers) == 1 else numbers if len(numbers) == 3 else None
        elif key in _MAPS and rest and _MAPS.index(key) < material.rank:
            texture = _look_up_map(folder, mtl, rest, maps, notes)
            if texture is not None:
                material.picture, material.scale, material.offset = texture
                material.rank = _MAPS.index(key)
        elif key in ("d", "tr") and rest:
            try:
                opacity = float(rest.split()[-1]) if key == "d" else 1 - float(rest.split()[-1])
            except ValueError:
                continue
            # Exporters do not agree whether 0 of ``d`` and 1 of ``Tr`` are clear or opaque.
            if 0 < opacity < _OPAQUE:
                notes.append(f"{PurePosixPath(mtl).name}: what is {opacity:.0%} opaque is shown opaque")
    return materials


def _look_up_map(
    folder: SourceFolder, mtl: str, rest: str, maps: dict[tuple[str, str], _Map | None], notes: list[str]
) -> _Map | None:
    """The picture, scale and offset of a map, cached in ``maps`` by file and words; None and a note without a
    picture."""
    key = (mtl, rest)
    if key in maps:
        return maps[key]
    if len(maps) >= _NAMES:
        notes.append(f"{PurePosixPath(mtl).name}: of more than {_NAMES} pictures the rest is not shown")
        return None
    scale, offset = (1.0, 1.0), (0.0, 0.0)
    while match := _OPTION.match(rest):  # a file name that may hold blanks follows the options
        rest = rest[match.end() :]
        numbers = [float(word) for word in (match["numbers"] or "").split()[:2]]
        if not numbers or max(map(abs, numbers)) > _FAR:
            continue
        if match["key"].lower() == "s":
            scale = (numbers[0], numbers[1] if len(numbers) > 1 else 1.0)
        elif match["key"].lower() == "o":
            offset = (numbers[0], numbers[1] if len(numbers) > 1 else 0.0)
    try:
        maps[key] = folder.relative_file_name(folder.find_file(rest, mtl)), scale, offset
    except RefusedError as error:
        maps[key] = None
        notes.append(f"{error.message}: the picture is not shown")
    return maps[key]
