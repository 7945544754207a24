"""Reading mesh files: OBJ, GLB, glTF, STL, PLY, DAE and MuJoCo's MSH, with their colours and pictures.
Every file that a mesh names is checked before trimesh reads it."""

import re
import struct
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from grs_agents.library.formats import check_xml_safety
from grs_agents.library.importing.source_folder import SourceFolder, find_obj_material_files
from grs_agents.library.importing.types import (
    Floats,
    Image,
    ImportLimits,
    Ints,
    MeshPart,
    RefusedError,
    SourceModel,
    Unit,
    Up,
)

SUFFIXES: Final = (".obj", ".glb", ".gltf", ".stl", ".ply", ".dae", ".msh")
_UNITS: Final[dict[str, Unit]] = {".glb": "m", ".gltf": "m", ".dae": "m"}
_UPS: Final[dict[str, Up]] = {".glb": "y", ".gltf": "y"}
_STL_HEADER, _STL_FACE = 84, 50
_GREY = (180, 180, 180)
_LIBRARY_ERRORS: Final = (ValueError, TypeError, LookupError, AttributeError, OSError, AssertionError, RuntimeError)
_LOAD_ERRORS: Final = (*_LIBRARY_ERRORS, ImportError, ArithmeticError, SyntaxError, struct.error)
"""What reading a broken file may end in."""


def read_mesh(folder: SourceFolder, name: str, limits: ImportLimits, texture: str | None = None) -> SourceModel:
    """The parts of a mesh file; ``texture`` is a picture for all of it. Names are relative to the source."""
    path = folder.resolve_file(name)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RefusedError(f"{name} is not one of {', '.join(SUFFIXES)}", "convert it")
    if not path.stat().st_size:
        raise RefusedError(f"{name} is empty", "export it again")
    _check_face_count(path.name, _declared_face_count(path, suffix), limits)
    image = read_texture_image(folder.resolve_file(texture), limits.pixels) if texture else None
    if suffix == ".msh":
        return SourceModel([_read_mujoco_msh(path, image)])
    scale, unit, up = 1.0, _UNITS.get(suffix, "auto"), _UPS.get(suffix, "auto")
    if suffix == ".obj" and texture is None:
        for image_name in find_obj_material_files(folder, name)[1]:
            picture = folder.resolve_file(image_name)
            read_texture_image(picture, limits.pixels, header_only=True)  # trimesh would go on without it
    if suffix == ".dae":
        check_xml_safety(path.read_bytes(), lambda message, remedy: RefusedError(f"{name}: {message}", remedy))
        scale, up = _read_dae_unit_and_up(path)
    meshes = _load_with_trimesh(path, folder, name, limits, blind=image is not None)
    if not meshes:
        raise RefusedError(f"{name} has no faces", "export the surface, not its points")
    _check_face_count(name, sum(len(mesh.faces) for mesh in meshes), limits)
    return SourceModel([_convert_to_mesh_part(mesh, scale, image, limits, name) for mesh in meshes], unit=unit, up=up)


def _check_face_count(name: str, faces: int, limits: ImportLimits) -> None:
    if faces > limits.faces:
        raise RefusedError(f"{name} has {faces} faces, {limits.faces} are the most", "simplify it")


def _declared_face_count(path: Path, suffix: str) -> int:
    """How many faces a file says that it has, before anything is made of them; 0 where it does not say."""
    if suffix == ".obj":
        with path.open("rb") as file:
            return sum(line.startswith(b"f ") for line in file)
    with path.open("rb") as file:
        head = file.read(4096)
    if suffix == ".stl" and len(head) >= _STL_HEADER:
        (count,) = struct.unpack("<I", head[80:84])
        return count if path.stat().st_size == _STL_HEADER + _STL_FACE * count else 0
    count = re.search(rb"element\s+face\s+(\d+)", head.split(b"end_header")[0]) if suffix == ".ply" else None
    return int(count[1]) if count else 0


def _read_dae_unit_and_up(path: Path) -> tuple[float, Up]:
    """The metres of a unit and the axis that points up, as a DAE file says; trimesh applies neither."""
    axes: dict[str, Up] = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
    for _, element in ElementTree.iterparse(path):
        if element.tag.rpartition("}")[2] == "asset":  # the first one is that of the whole file
            up, unit = element.findtext("{*}up_axis", ""), element.find("{*}unit")
            try:
                scale = float(unit.get("meter", "1")) if unit is not None else 1.0
            except ValueError:
                scale = 1.0
            return scale if np.isfinite(scale) and scale > 0 else 1.0, axes.get(up.strip(), "y")
    return 1.0, "y"


def _load_with_trimesh(path: Path, folder: SourceFolder, name: str, limits: ImportLimits, *, blind: bool) -> list[Any]:
    """The meshes with faces of a file, by trimesh."""
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
        if resolver.refused is not None:
            raise resolver.refused from error
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise RefusedError(f"{name} cannot be read: {reason}", "export it again") from error
    if resolver.refused is not None:
        raise resolver.refused
    return meshes


class _Resolver:
    """What trimesh opens beside a mesh file; nothing where its picture is given (``blind``)."""

    def __init__(self, folder: SourceFolder, name: str, *, blind: bool) -> None:
        self._folder, self._name, self._blind = folder, name, blind
        self.refused: RefusedError | None = None

    def get(self, name: str) -> bytes:
        """The content of a file that the mesh names."""
        if self._blind:
            raise FileNotFoundError(name)
        try:
            return self._folder.resolve_file(name.strip(), self._name).read_bytes()
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


def _convert_to_mesh_part(mesh: Any, scale: float, image: Image | None, limits: ImportLimits, name: str) -> MeshPart:
    """A mesh of trimesh, ``scale`` times as large."""
    vertices, faces = np.asarray(mesh.vertices, np.float64) * scale, np.asarray(mesh.faces, np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise RefusedError(f"{name}: a face names vertex {faces.max()} of {len(vertices)}", "export it again")
    if not np.isfinite(vertices[faces]).all():
        raise RefusedError(f"{name} has vertices that are not finite numbers (NaN or infinity)", "export it again")
    uvs = _face_corner_uvs(mesh, faces)
    if image is None or uvs is None:
        material = getattr(mesh.visual, "material", None)
        own = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        image = None if own is None else read_texture_image(own, limits.pixels)
    return MeshPart(vertices, faces, uvs if image is not None else None, image, _face_colors(mesh, len(faces)))


def _face_corner_uvs(mesh: Any, faces: Ints) -> Floats | None:
    """(F, 3, 2) texture coordinates of the corners, or None."""
    uvs = np.asarray(getattr(mesh.visual, "uv", ()), np.float64)
    return None if uvs.ndim != 2 or len(uvs) != len(mesh.vertices) or not np.isfinite(uvs).all() else uvs[:, :2][faces]


def _face_colors(mesh: Any, count: int) -> Image:
    """(F, 3) uint8 colour of each face, from its material, its own colour or its vertices' colours."""
    visual, grey = mesh.visual, np.tile(np.array(_GREY, np.uint8), (count, 1))
    material = getattr(visual, "material", None)
    if material is not None:
        main = getattr(material, "baseColorFactor", None)
        main = getattr(material, "main_color", None) if main is None else main
        rgb = np.asarray(_GREY if main is None else main).ravel()[:3]
        return np.tile(_rgb_to_uint8(rgb), (count, 1)) if len(rgb) == 3 else grey
    if getattr(visual, "kind", None) not in ("face", "vertex"):
        return grey
    colors = np.asarray(visual.face_colors)
    return colors[:, :3].astype(np.uint8) if len(colors) == count else grey


def _rgb_to_uint8(rgb: Any) -> Image:
    values = np.nan_to_num(np.asarray(rgb, np.float64))
    scale = 255.0 if np.issubdtype(np.asarray(rgb).dtype, np.floating) and values.max(initial=0) <= 1 else 1.0
    return np.clip(np.rint(values * scale), 0, 255).astype(np.uint8)


def _read_mujoco_msh(path: Path, image: Image | None) -> MeshPart:
    """MuJoCo's binary mesh: four counts, then positions, normals, texture coordinates and faces."""
    data = path.read_bytes()
    counts = struct.unpack("<4i", data[:16]) if len(data) >= 16 else (0, 0, 0, 0)
    vertices, normals, coordinates, faces = counts
    expected = 16 + 4 * (3 * vertices + 3 * normals + 2 * coordinates + 3 * faces)
    if min(counts) < 0 or vertices < 4 or faces < 1 or expected != len(data):
        raise RefusedError(f"{path.name} is no MSH file of {vertices} vertices and {faces} faces", "export it again")
    numbers = np.frombuffer(data, "<f4", 3 * (vertices + normals) + 2 * coordinates, 16).astype(np.float64)
    points = numbers[: 3 * vertices].reshape(-1, 3)
    index = np.frombuffer(data, "<i4", 3 * faces, len(data) - 12 * faces).reshape(-1, 3).astype(np.int64)
    if index.min() < 0 or index.max() >= vertices or not np.isfinite(points).all():
        raise RefusedError(f"{path.name} has faces or vertices that cannot be (NaN or out of range)", "export it again")
    uvs = None
    if coordinates == vertices and image is not None:
        flat = numbers[3 * (vertices + normals) :].reshape(-1, 2)
        uvs = np.stack([flat[:, 0], 1 - flat[:, 1]], axis=1)[index]
    grey = np.tile(np.array(_GREY, np.uint8), (len(index), 1))
    return MeshPart(points, index, uvs, image if uvs is not None else None, grey)


def read_texture_image(source: Any, pixels: int, *, header_only: bool = False) -> Image:
    """A picture as (H, W, 3) uint8 RGB, what is transparent over white.

    Args:
        source: a path or an opened Pillow image.
        pixels: the most it may have.
        header_only: only see that it is a picture of at most ``pixels``; the result is empty.
    """
    from PIL import Image as Pictures

    name = source.name if isinstance(source, Path) else "the texture"
    try:
        opened: Any = Pictures.open(source) if isinstance(source, Path) else source
        width, height = opened.size
        if width * height > pixels or min(width, height) < 1:
            raise RefusedError(f"{name} has {width} x {height} px, {pixels} are the most", "make it smaller")
        if header_only:
            return np.zeros((0, 0, 3), np.uint8)
        if opened.mode in ("RGBA", "LA", "PA") or "transparency" in opened.info:
            white: Any = Pictures.new("RGBA", opened.size, (255, 255, 255, 255))
            white.alpha_composite(opened.convert("RGBA"))
            opened = white
        return np.asarray(opened.convert("RGB"), np.uint8)
    except (OSError, ValueError, SyntaxError, Pictures.DecompressionBombError) as error:
        raise RefusedError(f"{name} is no picture: {str(error)[:120]}", "convert it to PNG") from error
