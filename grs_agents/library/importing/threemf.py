"""Reading 3MF, the format of 3D printing: a zip file of XML with objects, their copies, colours and pictures."""

import io
import zipfile
import zlib
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.bounded_streams import check_zip_compression, open_zip
from grs_agents.library.formats.model_file import check_xml_safety
from grs_agents.library.importing.textures import build_mesh_part, read_picture_or_note
from grs_agents.library.importing.types import (
    MIN_UNPACKED_BYTES,
    ZIP_ENTRY_BYTES,
    Floats,
    Image,
    ImportLimits,
    Ints,
    MeshPart,
    RefusedError,
)

_METRES: Final = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_MAIN: Final = "3D/3dmodel.model"
_MODEL_TYPE: Final = "/3dmodel"
_DEPTH: Final = 16
"""Levels of components in components."""
_MEMBERS: Final = 10_000
_COPIES: Final = 10_000
_SUPPORTS: Final = ("support", "solidsupport", "other")
_Key = tuple[str, str]
"""The file of an object or a property group in the package, and its identifier there."""


@dataclass
class _Object:
    """A mesh, and copies of other objects."""

    vertices: Floats
    faces: Ints
    properties: Ints  # (F, 3) row of the property group at each corner, -1 for none
    groups: list[str]  # of the faces, "" for none
    copies: list[tuple[_Key, Floats]]  # with 4 x 3 transforms, which rows are multiplied by from the left


@dataclass
class _Package:
    """Contents of the files of a package."""

    objects: dict[_Key, _Object] = field(default_factory=dict[_Key, _Object])
    colors: dict[_Key, list[Image]] = field(default_factory=dict[_Key, list[Image]])
    coordinates: dict[_Key, tuple[str, list[tuple[float, float]]]] = field(
        default_factory=dict[_Key, tuple[str, list[tuple[float, float]]]]
    )  # identifier of the texture, and texture coordinates
    textures: dict[_Key, str] = field(default_factory=dict[_Key, str])  # files in the package
    items: list[tuple[_Key, Floats]] = field(default_factory=list[tuple[_Key, Floats]])
    scale: float = 1e-3


def read_3mf(path: Path, limits: ImportLimits, notes: list[str]) -> list[MeshPart]:
    """The parts of a 3MF file in metres, z up, as its build has them; supports are left out.
    Raises RefusedError: it is no sound 3MF file, or larger than the limits."""
    package = _Package()
    try:
        with path.open("rb") as file, open_zip(file, path.name, _MEMBERS * ZIP_ENTRY_BYTES) as zipped:
            members = _Members(zipped, path, limits)
            rels = "_rels/.rels"
            relations = _parse_xml(members.read(rels), rels).iter() if rels in members else ()
            main = (item.get("Target", "") for item in relations if item.get("Type", "").endswith(_MODEL_TYPE))
            todo, done = [next(main, _MAIN).lstrip("/")], set[str]()
            while todo:
                name = todo.pop()
                if name not in done:
                    done.add(name)
                    _read_model_file(members.read(name), name, package, path.name)
                    todo += [key[0] for shape in package.objects.values() for key, _ in shape.copies]
                    todo += [key[0] for key, _ in package.items]
            images: dict[_Key, Image | None] = {}
            for key, name in package.textures.items():
                data = io.BytesIO(members.read(name) if name in members else b"")
                images[key] = read_picture_or_note(data, limits.pixels, notes)
    except RefusedError:
        raise
    except InputError as error:
        raise RefusedError(error.message, error.remedy) from error
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError) as error:
        raise RefusedError(f"{path.name} cannot be unpacked: {str(error)[:120]}", "export it again") from error
    except (ValueError, LookupError, SyntaxError) as error:
        raise RefusedError(f"{path.name} cannot be read: {str(error)[:120]}", "export it again") from error
    return _build_parts(package, images, limits, path.name, notes)


class _Members:
    """The files of a package; all together unpack to no more than an archive may."""

    def __init__(self, zipped: zipfile.ZipFile, path: Path, limits: ImportLimits) -> None:
        self._zipped, self._name = zipped, path.name
        self._left = min(limits.bytes, max(MIN_UNPACKED_BYTES, int(limits.ratio * path.stat().st_size)))
        self._infos = {info.filename.lstrip("/").casefold(): info for info in zipped.infolist()[:_MEMBERS]}

    def __contains__(self, file: str) -> bool:
        return file.casefold() in self._infos

    def read(self, file: str) -> bytes:
        """The content of a file."""
        if file not in self:
            raise RefusedError(f"{self._name} holds no {file[:80]!r}", "export it again")
        info = self._infos[file.casefold()]
        check_zip_compression(info, self._name)
        with self._zipped.open(info) as member:
            data = member.read(self._left + 1)
        self._left -= len(data)
        if self._left < 0:
            raise RefusedError(f"{self._name} unpacks to more than a model needs", "simplify it")
        return data


def _parse_xml(data: bytes, name: str) -> Element:
    check_xml_safety(data, lambda message, remedy: RefusedError(f"{name}: {message}", remedy))
    root = ElementTree.fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        for key in [key for key in element.attrib if "}" in key]:
            element.attrib[key.rpartition("}")[2]] = element.attrib.pop(key)
    return root


def _read_model_file(data: bytes, file: str, package: _Package, name: str) -> None:
    root = _parse_xml(data, name)
    if not package.objects and not package.items:
        package.scale = _METRES.get(root.get("unit", "millimeter"), 1e-3)
    for group in root.findall("resources/*"):
        key = (file, group.get("id", ""))
        if group.tag in ("basematerials", "colorgroup"):
            texts = [row.get("displaycolor", row.get("color", "")) for row in group]  # #RRGGBB or #RRGGBBAA
            package.colors[key] = [
                np.array([int(text[start : start + 2], 16) for start in (1, 3, 5)], np.uint8) for text in texts
            ]
        elif group.tag == "texture2dgroup":
            rows = [(float(row.get("u", "0")), float(row.get("v", "0"))) for row in group]
            package.coordinates[key] = (group.get("texid", ""), rows)
        elif group.tag == "texture2d":
            package.textures[key] = group.get("path", "").lstrip("/")
        elif group.tag == "object" and group.get("type", "model") not in _SUPPORTS:
            package.objects[key] = _read_object(group, file)
    for item in root.findall("build/item"):
        package.items.append(_read_copy(item, file))


def _read_object(group: Element, file: str) -> _Object:
    vertices = array("d")
    for vertex in group.iterfind("mesh/vertices/vertex"):
        vertices.extend((float(vertex.get("x", "")), float(vertex.get("y", "")), float(vertex.get("z", ""))))
    faces, properties, groups = array("q"), array("q"), list[str]()
    plain, row = group.get("pid", ""), int(group.get("pindex", "0"))
    for triangle in group.iterfind("mesh/triangles/triangle"):
        faces.extend(int(triangle.get(corner, "")) for corner in ("v1", "v2", "v3"))
        pid = triangle.get("pid", plain)
        first = int(triangle.get("p1", row if pid else -1))
        properties.extend((first, int(triangle.get("p2", first)), int(triangle.get("p3", first))))
        groups.append(pid)
    copies = [_read_copy(component, file) for component in group.iterfind("components/component")]
    return _Object(
        np.array(vertices, np.float64).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3),
        np.array(properties, np.int64).reshape(-1, 3),
        groups,
        copies,
    )


def _read_copy(element: Element, file: str) -> tuple[_Key, Floats]:
    numbers = [float(word) for word in element.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()]
    if len(numbers) != 12 or not np.isfinite(numbers).all():
        raise ValueError(f"a transform has {len(numbers)} finite numbers, not 12")
    home = element.get("path", "").lstrip("/") or file
    return (home, element.get("objectid", "")), np.array(numbers, np.float64).reshape(4, 3)


def _build_parts(
    package: _Package, images: dict[_Key, Image | None], limits: ImportLimits, name: str, notes: list[str]
) -> list[MeshPart]:
    """The parts of every object of the build, by their look."""
    parts: list[MeshPart] = []
    todo = [(key, transform, 0) for key, transform in package.items]
    todo = todo or [(key, np.eye(4, 3), 0) for key in package.objects]
    count = copies = 0
    while todo:
        key, transform, depth = todo.pop()
        copies += 1
        solid = package.objects.get(key)
        if solid is None:
            continue
        count += len(solid.faces)
        if count > limits.faces or copies > _COPIES or depth > _DEPTH:
            message = f"{name} has more than {limits.faces} faces, {_COPIES} copies or {_DEPTH} levels of components"
            raise RefusedError(message, "simplify it")
        column = np.eye(4)[:, 3:]
        matrix = np.hstack([transform, column])
        todo += [(inner, (np.hstack([placed, column]) @ matrix)[:, :3], depth + 1) for inner, placed in solid.copies]
        if len(solid.faces):
            if solid.faces.min() < 0 or solid.faces.max() >= len(solid.vertices):
                message = f"{name}: a face names vertex {solid.faces.max()} of {len(solid.vertices)}"
                raise RefusedError(message, "export it again")
            vertices = (solid.vertices @ transform[:3] + transform[3]) * package.scale
            if not np.isfinite(vertices).all():
                raise RefusedError(f"{name} has vertices that are not finite numbers", "export it again")
            turn = slice(None, None, -1) if np.linalg.det(transform[:3]) < 0 else slice(None)  # a mirror's outside
            groups = np.array(solid.groups)
            for group in sorted(set(solid.groups)):
                chosen = groups == group
                rows = solid.properties[chosen][:, turn]
                uvs, image, colors = _look_up_group(package, images, (key[0], group), rows)
                parts.append(build_mesh_part(vertices, solid.faces[chosen][:, turn], uvs, image, colors, name, notes))
    return parts


def _look_up_group(
    package: _Package, images: dict[_Key, Image | None], group: _Key, rows: Ints
) -> tuple[Floats | None, Image | None, Image | None]:
    """Texture coordinates (F, 3, 2), picture and colours (F, 3) of faces with these rows of a property group."""
    if group in package.coordinates:
        texture, coordinates = package.coordinates[group]
        image = images.get((group[0], texture))
        if coordinates and image is not None and 0 <= rows.min() <= rows.max() < len(coordinates):
            return np.array(coordinates, np.float64)[rows], image, None
    colors = package.colors.get(group, [])
    if colors and 0 <= rows.min() <= rows.max() < len(colors):
        return None, None, np.stack(colors)[rows].mean(axis=1).round().astype(np.uint8)
    return None, None, None
