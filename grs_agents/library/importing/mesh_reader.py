"""Reading mesh files: OBJ, GLB, glTF, STL, PLY, DAE, OFF, 3MF and MuJoCo's MSH, with their colours and pictures.
Every file that a mesh names is checked before trimesh reads it."""

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from grs_agents.library.formats.model_file import check_xml_safety
from grs_agents.library.importing.gltf import read_gltf
from grs_agents.library.importing.obj_reader import read_obj
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.textures import (
    GREY,
    build_mesh_part,
    color_to_uint8,
    read_picture_or_note,
)
from grs_agents.library.importing.threemf import read_3mf
from grs_agents.library.importing.types import (
    Floats,
    Image,
    ImportLimits,
    MeshPart,
    RefusedError,
    SourceModel,
    Unit,
    Up,
)

SUFFIXES: Final = (".obj", ".glb", ".gltf", ".stl", ".ply", ".dae", ".off", ".3mf", ".msh")
_STL_HEADER, _STL_FACE = 84, 50
_LIBRARY_ERRORS: Final = (ValueError, TypeError, LookupError, AttributeError, OSError, AssertionError, RuntimeError)
_LOAD_ERRORS: Final = (*_LIBRARY_ERRORS, ImportError, NameError, ArithmeticError, SyntaxError, struct.error)
"""Errors of trimesh and its readers on broken files."""


def read_mesh(folder: SourceFolder, name: str, limits: ImportLimits, texture: str | None = None) -> SourceModel:
    """The parts of a mesh file; ``texture`` is a picture for all of it. Names are relative to the source."""
    path = folder.resolve_file(name)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RefusedError(f"{name} is not one of {', '.join(SUFFIXES)}", "convert it")
    if not path.stat().st_size:
        raise RefusedError(f"{name} is empty", "export it again")
    if suffix == ".ply":  # its header counts the faces before they are parsed
        with path.open("rb") as file:
            count = re.search(rb"element\s+face\s+(\d+)", file.read(4096).split(b"end_header")[0])
        _check_face_count(path.name, int(count[1]) if count else 0, limits)
    notes: list[str] = []
    image = None if texture is None else read_picture_or_note(folder.resolve_file(texture), limits.pixels, notes)
    if suffix in (".glb", ".gltf"):
        model = read_gltf(folder, name, limits, image)
        return replace(model, notes=notes + model.notes)
    if suffix == ".obj":
        parts, more = read_obj(folder, name, limits, image)
        return _check_model(SourceModel(parts, notes=notes + more), name)
    if suffix == ".3mf":
        return _check_model(SourceModel(read_3mf(path, limits, notes), unit="m", up="z", notes=notes), name)
    if suffix in _READERS:
        return SourceModel([_READERS[suffix](path, image, limits, notes)], notes=notes)
    scale = 1.0
    unit: Unit = "auto"
    up: Up = "auto"
    if suffix == ".dae":
        check_xml_safety(path.read_bytes(), lambda message, remedy: RefusedError(f"{name}: {message}", remedy))
        unit = "m"
        scale, up = _read_dae_unit_and_up(path)
    meshes = _load_with_trimesh(path, folder, name, limits, notes, blind=image is not None)
    _check_face_count(name, sum(len(mesh.faces) for mesh in meshes), limits)
    parts = [_convert_to_mesh_part(mesh, scale, image, limits, name, notes) for mesh in meshes]
    return _check_model(SourceModel(parts, unit=unit, up=up, notes=list(dict.fromkeys(notes))), name)


def _check_model(model: SourceModel, name: str) -> SourceModel:
    if not model.parts:
        raise RefusedError(f"{name} has no faces", "export the surface, not its points")
    return model


def _check_face_count(name: str, faces: int, limits: ImportLimits) -> None:
    if faces > limits.faces:
        raise RefusedError(f"{name} has {faces} faces, {limits.faces} are the most", "simplify it")


def _read_dae_unit_and_up(path: Path) -> tuple[float, Up]:
    """The metres of a unit and the axis that points up, as a DAE file says; trimesh applies neither."""
    axes: dict[str, Up] = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
    for _, element in ElementTree.iterparse(path):
        if element.tag.rpartition("}")[2] == "asset":  # the first element is that of the whole file
            up, unit = element.findtext("{*}up_axis", ""), element.find("{*}unit")
            try:
                scale = float(unit.get("meter", "1")) if unit is not None else 1.0
            except ValueError:
                scale = 1.0
            return scale if np.isfinite(scale) and scale > 0 else 1.0, axes.get(up.strip(), "y")
    return 1.0, "y"


def _load_with_trimesh(
    path: Path, folder: SourceFolder, name: str, limits: ImportLimits, notes: list[str], *, blind: bool
) -> list[Any]:
    """The meshes with faces of a file, by trimesh; pictures that are not there are noted."""
    import trimesh

    resolver: Any = _Resolver(folder, name, blind=blind)
    try:
        with path.open("rb") as file:
            scene: Any = trimesh.load_scene(file, file_type=path.suffix.lower()[1:], resolver=resolver, process=False)
        meshes = [mesh for mesh in scene.dump() if hasattr(mesh, "faces") and len(mesh.faces)]
    except RefusedError:
        raise
    except MemoryError as error:
        raise RefusedError(f"{name} needs more memory than {limits.memory} bytes", "simplify it") from error
    except ModuleNotFoundError as error:
        remedy = 'run: pip install "grs-agents[assets]"' if error.name in ("collada", "lxml") else "convert it to GLB"
        raise RefusedError(f"{name} needs the package {error.name}", remedy) from error
    except _LOAD_ERRORS as error:
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise RefusedError(f"{name} cannot be read: {reason}", "export it again") from error
    if resolver.refused is not None:
        notes.append(f"{resolver.refused.message}: the picture is not shown")
    return meshes


class _Resolver:
    """Opens the files that trimesh asks for; with ``blind``, none."""

    def __init__(self, folder: SourceFolder, name: str, *, blind: bool) -> None:
        self._folder, self._name, self._blind = folder, name, blind
        self.refused: RefusedError | None = None

    def get(self, name: str) -> bytes:
        """The content of a file that the mesh names."""
        if self._blind:
            raise FileNotFoundError(name)
        try:
            return self._folder.find_file(name, self._name).read_bytes()
        except RefusedError as error:
            self.refused = self.refused or error
            raise FileNotFoundError(name) from error

    def keys(self) -> list[str]:
        """None: there is nothing to guess from."""
        return []

    def namespaced(self, namespace: str) -> "_Resolver":
        """The same files."""
        return self

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def __contains__(self, name: str) -> bool:
        return False


def _convert_to_mesh_part(
    mesh: Any, scale: float, image: Image | None, limits: ImportLimits, name: str, notes: list[str]
) -> MeshPart:
    """A mesh of trimesh, ``scale`` times as large."""
    vertices, faces = np.asarray(mesh.vertices, np.float64) * scale, np.asarray(mesh.faces, np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise RefusedError(f"{name}: a face names vertex {faces.max()} of {len(vertices)}", "export it again")
    _check_finite(vertices[faces], name)
    uvs = np.asarray(getattr(mesh.visual, "uv", ()), np.float64)
    uvs = None if uvs.ndim != 2 or len(uvs) != len(mesh.vertices) or not np.isfinite(uvs).all() else uvs[:, :2][faces]
    if image is None:
        material = getattr(mesh.visual, "material", None)
        base_color, simple = (getattr(material, name, None) for name in ("baseColorTexture", "image"))
        if base_color is None and simple is not None and simple.format is None:  # a placeholder of trimesh
            return build_mesh_part(vertices, faces, uvs, None, None, name, notes)
        base_color = simple if base_color is None else base_color
        image = None if base_color is None else read_picture_or_note(base_color, limits.pixels, notes)
    return build_mesh_part(vertices, faces, uvs, image, _face_colors(mesh, len(faces)), name, notes)


def _check_finite(points: Floats, name: str) -> None:
    if not np.isfinite(points).all():
        raise RefusedError(f"{name} has vertices that are not finite numbers (NaN or infinity)", "export it again")


def _face_colors(mesh: Any, count: int) -> Image | None:
    """(F, 3) uint8 colour of each face, from its material, its own colour or its vertices' colours; None without."""
    visual = mesh.visual
    material = getattr(visual, "material", None)
    if material is not None:
        main = getattr(material, "baseColorFactor", None)
        main = getattr(material, "main_color", None) if main is None else main
        rgb = np.asarray(GREY if main is None else main).ravel()[:3]
        return np.tile(color_to_uint8(rgb), (count, 1)) if len(rgb) == 3 else None
    if getattr(visual, "kind", None) not in ("face", "vertex"):
        return None
    colors = np.asarray(visual.face_colors)
    return colors[:, :3].astype(np.uint8) if len(colors) == count else None


def _read_stl(path: Path, image: Image | None, limits: ImportLimits, notes: list[str]) -> MeshPart:
    """Read an STL file, binary or text; all of its solids form a single part, with the colours of binary files.

    Neither the word ``solid`` at the beginning nor the size distinguishes the two forms: binary files may begin with it
    and be longer than their faces need.
    """
    size, name = path.stat().st_size, path.name
    with path.open("rb") as file:
        head = file.read(4096)
    count = int.from_bytes(head[80:84], "little") if len(head) >= _STL_HEADER else 0
    is_text = head.lstrip()[:5].lower() == b"solid" and b"facet" in head.lower()
    if count and size >= _STL_HEADER + _STL_FACE * count and not (is_text and size != _STL_HEADER + _STL_FACE * count):
        _check_face_count(name, count, limits)
        layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        rows = np.fromfile(path, layout, count, offset=_STL_HEADER)
        corners, colors = rows["corners"].astype(np.float64), _stl_colors(head[:80], rows["attribute"])
    elif is_text:
        lines = (line.split() for line in path.read_bytes().lower().splitlines())
        vertices = [words[1:4] for words in lines if words and words[0] == b"vertex"]
        _check_face_count(name, len(vertices) // 3, limits)
        try:
            points = np.array(vertices, np.float64).reshape(-1, 3, 3)
        except ValueError as error:
            raise RefusedError(
                f"{name} has {len(vertices)} corners that are not three numbers each", "export it again"
            ) from error
        corners, colors = points, None
    else:
        room = max(0, size - _STL_HEADER) // _STL_FACE
        message = f"{name} is no STL file: its header says {count} faces, its {size} bytes have room for {room}"
        raise RefusedError(message, "export it again")
    if not len(corners):
        raise RefusedError(f"{name} has no faces", "export it again")
    _check_finite(corners, name)
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return build_mesh_part(corners.reshape(-1, 3), faces, None, image, colors, name, notes)


def _stl_colors(header: bytes, attributes: Any) -> Image | None:
    """(F, 3) colours of 5 bits a channel: blue first if bit 15 is set (VisCAM and SolidView), or, after a header with
    ``COLOR=`` (Materialise Magics), red first if it is not set; None without colours."""
    bits = attributes.astype(np.int64)
    channels = np.stack([bits & 31, bits >> 5 & 31, bits >> 10 & 31], axis=1)
    at = header.find(b"COLOR=")
    has_color = (bits >> 15 == 0) if at >= 0 else (bits >> 15 == 1)
    if at < 0 and not has_color.any():
        return None
    base = header[at + 6 : at + 9] if at >= 0 else b""
    plain = np.array(list(base) if len(base) == 3 else GREY, np.int64)
    shown = channels if at >= 0 else channels[:, ::-1]
    return np.where(has_color[:, None], np.rint(shown * 255 / 31), plain).astype(np.uint8)


_OFF_HEADER: Final = re.compile(r"(?P<st>ST)?(?P<color>C)?(?P<normal>N)?OFF\s*(?P<counts>\d.*)?")


def _read_off(path: Path, image: Image | None, limits: ImportLimits, notes: list[str]) -> MeshPart:
    """An OFF file as text, with the colours of its faces or vertices; the counts may follow the first word at once."""
    name = path.name
    text = path.read_bytes().decode("utf-8", errors="replace")
    lines = [line for row in text.split("\n") if (line := row.partition("#")[0].strip())]
    header = _OFF_HEADER.fullmatch(lines[0]) if lines else None
    if header is None:
        raise RefusedError(f"{name} does not begin with OFF, COFF, NOFF or STOFF", "save it as OFF in text form")
    rows = [header["counts"], *lines[1:]] if header["counts"] else lines[1:]
    try:
        count, face_count = (int(word) for word in rows[0].split()[:2])
        _check_face_count(name, face_count, limits)
        table = [[float(word) for word in row.split()] for row in rows[1 : count + 1]]
        vertices = np.array([row[:3] for row in table], np.float64).reshape(count, 3)
        faces, plain = list[tuple[int, int, int]](), list[list[float]]()
        for row in rows[count + 1 : count + 1 + face_count]:
            words = row.split()
            size = int(words[0])
            corners = [int(word) for word in words[1 : size + 1]]
            faces += [(corners[0], corners[number], corners[number + 1]) for number in range(1, len(corners) - 1)]
            rest = [float(word) for word in words[size + 1 : size + 4]]
            plain += [rest if len(rest) == 3 else []] * max(0, len(corners) - 2)
            _check_face_count(name, len(faces), limits)
    except (ValueError, IndexError) as error:
        raise RefusedError(f"{name} cannot be read: {str(error)[:120]}", "export it again") from error
    index = np.array(faces, np.int64).reshape(-1, 3)
    if not len(index) or index.min() < 0 or index.max() >= count:
        raise RefusedError(f"{name} has no faces of its {count} vertices", "export the surface, not its points")
    _check_finite(vertices[index], name)
    start = 6 if header["normal"] else 3
    point_colors = [row[start : start + 3] for row in table] if header["color"] else []
    colors: Image | None = None
    if any(plain):
        grey = [float(level) for level in GREY]
        colors = color_to_uint8(np.array([color or grey for color in plain]))
    elif point_colors and all(len(color) == 3 for color in point_colors):
        colors = color_to_uint8(np.array(point_colors)[index].mean(axis=1))
    return build_mesh_part(vertices, index, None, image, colors, name, notes)


def _read_mujoco_msh(path: Path, image: Image | None, limits: ImportLimits, notes: list[str]) -> MeshPart:
    """MuJoCo's binary mesh: four counts, then positions, normals, texture coordinates and faces."""
    data = path.read_bytes()
    counts = struct.unpack("<4i", data[:16]) if len(data) >= 16 else (0, 0, 0, 0)
    vertices, normals, coordinates, faces = counts
    expected = 16 + 4 * (3 * vertices + 3 * normals + 2 * coordinates + 3 * faces)
    if min(counts) < 0 or vertices < 4 or faces < 1 or expected != len(data):
        raise RefusedError(f"{path.name} is no MSH file of {vertices} vertices and {faces} faces", "export it again")
    _check_face_count(path.name, faces, limits)
    numbers = np.frombuffer(data, "<f4", 3 * (vertices + normals) + 2 * coordinates, 16).astype(np.float64)
    points = numbers[: 3 * vertices].reshape(-1, 3)
    index = np.frombuffer(data, "<i4", 3 * faces, len(data) - 12 * faces).reshape(-1, 3).astype(np.int64)
    if index.min() < 0 or index.max() >= vertices or not np.isfinite(points).all():
        raise RefusedError(f"{path.name} has faces or vertices that cannot be (NaN or out of range)", "export it again")
    uvs = None
    if coordinates == vertices:
        flat = numbers[3 * (vertices + normals) :].reshape(-1, 2)
        uvs = np.stack([flat[:, 0], 1 - flat[:, 1]], axis=1)[index]
    return build_mesh_part(points, index, uvs, image, None, path.name, notes)


_READERS: Final = {".stl": _read_stl, ".off": _read_off, ".msh": _read_mujoco_msh}
