"""Reading URDF and MJCF of one rigid object with meshes of any format: staged as OBJ for the library's readers."""

import tempfile
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from grs_agents.errors import InputError
from grs_agents.files import write_text
from grs_agents.library.asset import Quantity
from grs_agents.library.formats import parse_xml_safely, read_mjcf, read_text, read_urdf
from grs_agents.library.importing.convex_decomposition import (
    MAX_VERTICES,
    compute_convex_hull,
    decompose_into_convex_parts,
)
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import concatenate_mesh_parts
from grs_agents.library.importing.types import (
    UP_TO_Z,
    Collider,
    Floats,
    ImportOptions,
    MeshPart,
    RefusedError,
    SourceItem,
    SourceModel,
)
from grs_agents.library.mesh_files import format_obj_text, triangulate_primitive
from grs_agents.library.shapes import ObjectModel, Shape, matrix_from_quaternion

_GREY = (0.7, 0.7, 0.7, 1.0)


def read_urdf_or_mjcf(folder: SourceFolder, item: SourceItem, options: ImportOptions) -> SourceModel:
    """What a URDF or MJCF file says, in metres with z up."""
    path, is_mjcf = folder.resolve_file(item.file), item.kind == "mjcf"

    def make_refused_error(message: str, remedy: str) -> InputError:
        return RefusedError(f"{item.file}: {message}", remedy)

    with tempfile.TemporaryDirectory(prefix="grs-import-") as name:
        stage = _Stage(Path(name), folder, item.file, options)
        try:
            top = parse_xml_safely(read_text(path), make_refused_error)
            (_stage_mjcf_meshes if is_mjcf else _stage_urdf_meshes)(top, stage)
            target = stage.home / ("object.xml" if is_mjcf else "object.urdf")
            target.write_bytes(ElementTree.tostring(top))
            model = (read_mjcf if is_mjcf else read_urdf)(target, stage.home)
        except RefusedError:
            raise
        except InputError as error:
            raise RefusedError(f"{item.file}: {error.message.replace(name, '').lstrip('/')}", error.remedy) from error
    has_friction = any("friction" in element.attrib or element.tag == "lateral_friction" for element in top.iter())
    return _build_source_model(model, stage.meshes, has_friction, 1 if is_mjcf else options.parts)


class _Stage:
    """A folder of OBJ files that stand for the meshes of a description."""

    def __init__(self, home: Path, source: SourceFolder, description: str, options: ImportOptions) -> None:
        self.home, self.meshes = home, dict[str, list[MeshPart]]()
        self._source, self._description, self._options = source, description, options

    def resolve_source_path(self, name: str) -> str:
        """A file that the description names, relative to the source; errors as `Folder.path`."""
        return self._source.relative_file_name(self._source.resolve_file(name, self._description))

    def resolve_package_path(self, name: str) -> str:
        """`resolve_source_path` of a URDF's file name, which may begin with ``package://NAME/`` or ``file://``."""
        name = name.removeprefix("file://")
        if not name.startswith("package://"):
            return self.resolve_source_path(name)
        rest, home = name.removeprefix("package://"), (self._source.root / self._description).parent
        tails = (rest, rest.partition("/")[2])
        levels = len(PurePosixPath(self._description).parts)
        places = ["../" * level + tail for tail in tails for level in range(levels) if tail]
        return self.resolve_source_path(next((place for place in places if (home / place).is_file()), tails[1] or rest))

    def convert_mesh_to_obj(self, source: str, texture: str | None = None) -> str:
        """Read a mesh (with z up) and write it as OBJ; its file name in the folder."""
        reading, name = read_mesh(self._source, source, self._options.limits, texture), f"mesh{len(self.meshes)}.obj"
        self.meshes[name] = [
            _scale_turn_and_move_part(part, np.ones(3), UP_TO_Z[reading.up], np.zeros(3)) for part in reading.parts
        ]
        vertices, faces = concatenate_mesh_parts(self.meshes[name])
        write_text(self.home / name, format_obj_text(vertices, faces[:1]))  # the readers want the vertices
        return name


def _stage_urdf_meshes(top: Element, stage: _Stage) -> None:
    for mesh in top.iter("mesh"):
        mesh.set("filename", stage.convert_mesh_to_obj(stage.resolve_package_path(mesh.get("filename", ""))))
    for material in top.iter("material"):
        for texture in material.findall("texture"):
            stage.resolve_package_path(texture.get("filename", ""))
            material.remove(texture)  # a mesh brings its own picture


def _stage_mjcf_meshes(top: Element, stage: _Stage) -> None:
    mesh_folder, texture_folder = _remove_mesh_texture_folders(top)
    pictures = _texture_file_by_mesh(top)
    for mesh in top.findall("asset/mesh"):
        file = mesh.get("file", "")
        name = mesh.get("name") or PurePosixPath(file).stem
        source, picture = stage.resolve_source_path(mesh_folder + file), pictures.get(name)
        mesh.set("name", name)
        texture = stage.resolve_source_path(texture_folder + picture) if picture else None
        mesh.set("file", stage.convert_mesh_to_obj(source, texture))
    if top.find(".//inertial") is None:
        for geom in top.iter("geom"):
            if geom.get("type") == "mesh":
                geom.attrib.setdefault("mass", "0")  # weighed from its volume later


def _remove_mesh_texture_folders(top: Element) -> tuple[str, str]:
    """The folders of an MJCF file's meshes and textures, as prefixes; they are removed from it."""
    folders = {"meshdir": "", "texturedir": "", "assetdir": ""}
    for compiler in top.findall("compiler"):
        folders |= {name: compiler.attrib.pop(name) for name in folders if name in compiler.attrib}
    names = (folders["meshdir"] or folders["assetdir"], folders["texturedir"] or folders["assetdir"])
    mesh, texture = (f"{name.rstrip('/')}/" if name else "" for name in names)
    return mesh, texture


def _texture_file_by_mesh(top: Element) -> dict[str, str]:
    """The picture file of each mesh of an MJCF file that a geom shows with a textured material."""
    files = {texture.get("name"): texture.get("file", "") for texture in top.findall("asset/texture")}
    materials = {entry.get("name"): files.get(entry.get("texture"), "") for entry in top.findall("asset/material")}
    return {geom.get("mesh", ""): materials.get(geom.get("material"), "") for geom in top.iter("geom")}


def _build_source_model(
    model: ObjectModel, meshes: dict[str, list[MeshPart]], has_friction: bool, max_parts: int
) -> SourceModel:
    """What an object shows and what of it collides; its meshes collide as at most ``max_parts`` hulls each."""
    colliders: list[Collider] = []
    notes: list[str] = []
    for shape in model.colliders:
        if shape.kind == "mesh":
            vertices, faces = concatenate_mesh_parts(_shape_to_mesh_parts(shape, meshes))
            if max_parts == 1:
                colliders.append(compute_convex_hull(vertices, MAX_VERTICES))
                continue
            hulls, more = decompose_into_convex_parts(vertices, faces, False, max_parts)
            colliders += hulls
            notes += more
        else:
            colliders.append(shape.model_copy(update={"color": None, "texture": None}))
    parts = [_apply_shape_color(part, shape) for shape in model.visuals for part in _shape_to_mesh_parts(shape, meshes)]
    mass = Quantity(value=model.mass, provenance="catalogue", deviation=0.1) if model.mass > 0 else None
    friction = Quantity(value=model.friction, provenance="catalogue", deviation=0.2) if has_friction else None
    return SourceModel(
        parts=parts, colliders=colliders or None, unit="m", up="z", mass=mass, friction=friction, notes=notes
    )


def _shape_to_mesh_parts(shape: Shape, meshes: dict[str, list[MeshPart]]) -> list[MeshPart]:
    """The triangles of a shape in the object's frame."""
    turn, position = matrix_from_quaternion(shape.quaternion), np.asarray(shape.position)
    if shape.kind == "mesh":
        return [
            _scale_turn_and_move_part(part, np.asarray(shape.size), turn, position) for part in meshes[shape.mesh or ""]
        ]
    corners = triangulate_primitive(shape).corners
    part = MeshPart(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return [_scale_turn_and_move_part(part, np.ones(3), turn, position)]


def _scale_turn_and_move_part(part: MeshPart, scale: Floats, turn: Floats, position: Floats) -> MeshPart:
    return MeshPart(part.vertices * scale @ turn.T + position, part.faces, part.uvs, part.image, part.colors)


def _apply_shape_color(part: MeshPart, shape: Shape) -> MeshPart:
    """A description's own colour goes over what a mesh without a picture says."""
    if part.image is not None or (shape.color is None and part.colors is not None):
        return part
    rgb = np.rint(np.array((shape.color or _GREY)[:3]) * 255).astype(np.uint8)
    return MeshPart(part.vertices, part.faces, part.uvs, part.image, np.tile(rgb, (len(part.faces), 1)))
