"""Reading URDF, SDF and MJCF of a single rigid object with meshes of any format, staged as OBJ for the library's
readers."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_text
from grs_agents.library.asset import Quantity
from grs_agents.library.formats.mjcf import MjcfDefaults, read_mjcf
from grs_agents.library.formats.model_file import parse_xml_safely, read_text
from grs_agents.library.formats.urdf import read_urdf
from grs_agents.library.importing.convex_decomposition import (
    MAX_VERTICES,
    compute_convex_hull,
    decompose_into_convex_parts,
)
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.sdf import convert_sdf_to_urdf
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import concatenate_mesh_parts
from grs_agents.library.importing.textures import build_mesh_part, read_picture_or_note
from grs_agents.library.importing.types import (
    UP_TO_Z,
    Collider,
    Floats,
    Image,
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
    """The object of a URDF, SDF or MJCF file, in metres with z up."""
    path, is_mjcf = folder.resolve_file(item.file), item.kind == "mjcf"

    def make_refused_error(message: str, remedy: str) -> InputError:
        return RefusedError(f"{item.file}: {message}", remedy)

    with tempfile.TemporaryDirectory(prefix="grs-import-") as name:
        target = Path(name, "object.xml" if is_mjcf else "object.urdf")
        stage = _Stage(Path(name), folder, item.file, options)
        try:
            top = parse_xml_safely(_mend_xml(read_text(path)), make_refused_error)
            if path.suffix.lower() == ".sdf":
                top = convert_sdf_to_urdf(top, make_refused_error, stage.notes)
            has_mass = True
            if is_mjcf:
                has_mass = _stage_mjcf_meshes(top, stage)
            else:
                _stage_urdf_meshes(top, stage)
            target.write_bytes(ElementTree.tostring(top))
            model = (read_mjcf if is_mjcf else read_urdf)(target, stage.home)
        except RefusedError:
            raise
        except InputError as error:
            message = error.message.replace(name, "").lstrip("/").removeprefix(f"{target.name}: ")
            raise RefusedError(f"{item.file}: {message}", error.remedy) from error
    has_friction = any("friction" in element.attrib or element.tag == "lateral_friction" for element in top.iter())
    return _build_source_model(model, stage, has_mass, has_friction, 1 if is_mjcf else options.parts)


_PREFIX: Final = re.compile(r"<(?:/\s*)?([A-Za-z_][\w.-]*):|\s([A-Za-z_][\w.-]*):[\w.-]+\s*=")

_DECLARED: Final = re.compile(r"xmlns:([A-Za-z_][\w.-]*)")


def _mend_xml(text: str) -> str:
    """The text of an XML file as lenient parsers see it: its declaration may follow other text, and prefixes
    (``xacro:``, ``gazebo:``) need no namespace."""
    text = re.sub(r"<\?xml\s[^<>]*\?>", "", text.lstrip("\ufeff"), count=1).lstrip()
    root = re.search(r"<[A-Za-z_][\w.-]*(?=[\s/>])", text)
    prefixes = {first or second for first, second in _PREFIX.findall(text)} - {"xmlns", "xml"}
    missing = sorted(prefixes - set(_DECLARED.findall(text)))
    if root is None or not missing:
        return text
    declared = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in missing)
    return text[: root.end()] + declared + text[root.end() :]


_Numbers = tuple[float, ...]
_MOST: Final = 1e4
"""Bound of scales and coordinates."""
_MAX_MASS: Final = 1000.0
"""kg"""
_MAX_FRICTION: Final = 100.0


class _Stage:
    """A folder of OBJ files in place of the meshes of a description, in its units and axes."""

    def __init__(self, home: Path, source: SourceFolder, description: str, options: ImportOptions) -> None:
        self.home, self.description = home, description
        self.meshes: dict[str, list[MeshPart]] = {}
        self.notes: list[str] = []
        self.notes_by_mesh: dict[str, list[str]] = {}  # apart, for a mesh that only collides needs no look
        self.names: dict[tuple[object, ...], str] = {}  # in the stage, by the ingredients of a mesh
        self._source, self._limits = source, options.limits

    def find_picture(self, name: str) -> str | None:
        """A picture that the description names, relative to the source; None and a note if it is missing."""
        try:
            return self._source.relative_file_name(self._source.find_file(name, self.description))
        except RefusedError as error:
            self.notes.append(f"{error.message}: the picture is not shown")
            return None

    def read_picture(self, picture: str | None) -> Image | None:
        """(H, W, 3) of a picture of the source; None and a note if it cannot be read."""
        if picture is None:
            return None
        return read_picture_or_note(self._source.root / picture, self._limits.pixels, self.notes)

    def mean_picture_color(self, picture: str) -> Floats | None:
        """(3,) red, green, blue in 0..1 of a picture on a shape without texture coordinates; None if it is broken."""
        image = self.read_picture(picture)
        if image is None:
            return None
        self.notes.append(f"{picture}: a primitive shape is shown in its mean colour")
        return image.reshape(-1, 3).mean(axis=0) / 255

    def read_mesh_file(self, name: str, picture: str | None) -> SourceModel:
        """The parts of a mesh that the description names, with z up and with ``picture`` on them."""
        file = self._source.relative_file_name(self._source.find_file(name, self.description))
        reading = read_mesh(self._source, file, self._limits, picture)
        if file.lower().endswith(".dae"):  # RViz and Gazebo take its coordinates as they are
            return reading
        parts = [_place_part(part, np.ones(3), UP_TO_Z[reading.up], np.zeros(3)) for part in reading.parts]
        return replace(reading, parts=parts)

    def stage_parts(self, parts: list[MeshPart], notes: list[str]) -> str:
        """The file name in the stage of a mesh of these parts."""
        name = f"mesh{len(self.meshes)}.obj"
        self.meshes[name], self.notes_by_mesh[name] = parts, notes
        vertices, faces = concatenate_mesh_parts(parts)
        write_text(self.home / name, format_obj_text(vertices, faces[:1]))  # the readers want the vertices
        return name

    def parse_numbers(self, text: str, name: str, counts: Sequence[int] | None) -> _Numbers:
        """Finite numbers of an attribute; their count is in ``counts``, if given."""
        try:
            numbers = tuple(float(word) for word in text.split())
            sound = all(abs(number) <= _MOST for number in numbers)
        except ValueError:
            numbers, sound = (), False
        if not sound or (counts is not None and len(numbers) not in counts):
            allowed = "" if counts is None else f"{' or '.join(map(str, counts))} "
            message = f"{self.description}: {name} is {text[:60]!r}"
            raise RefusedError(message, f"give {allowed}numbers of at most {_MOST:g}")
        return numbers

    def parse_scale(self, text: str) -> _Numbers:
        """The scale of a mesh along its axes; negative numbers mirror it."""
        numbers = self.parse_numbers(text, "scale", (1, 3))
        if not all(numbers):
            message = f"{self.description}: scale {text[:60]!r} flattens the mesh"
            raise RefusedError(message, "give numbers other than 0")
        return numbers * 3 if len(numbers) == 1 else numbers


def _stage_urdf_meshes(top: Element, stage: _Stage) -> None:
    """Replace the meshes and materials of a URDF by those of the stage."""
    described: dict[str, Element] = {}
    for material in top.iter("material"):
        if len(material):
            described.setdefault(material.get("name", ""), material)
    for link in top.findall("link"):
        for element in [*link.findall("visual"), *link.findall("collision")]:
            picture: str | None = None
            color: Floats | None = None
            for material in element.findall("material"):
                color, picture = _read_urdf_material(material, described, stage)
                element.remove(material)
            for shape in element.findall("geometry/*"):
                if shape.tag == "capsule":
                    (radius,), (length,) = (
                        stage.parse_numbers(shape.get(name, ""), name, (1,)) for name in ("radius", "length")
                    )
                    shape.tag = "cylinder"
                    shape.set("length", f"{length + 2 * radius:.9g}")
                if shape.tag != "mesh":
                    color = color if picture is None else stage.mean_picture_color(picture)
                    continue
                scale = stage.parse_scale(shape.attrib.pop("scale", "1 1 1"))
                key = (shape.get("filename", ""), picture, scale)
                if key not in stage.names:
                    reading = stage.read_mesh_file(key[0], picture)
                    parts = [_place_part(part, np.asarray(scale), np.eye(3), np.zeros(3)) for part in reading.parts]
                    stage.names[key] = stage.stage_parts(parts, reading.notes)
                shape.set("filename", stage.names[key])
                color = color if picture is None else None  # the parts of the mesh have it
            if color is not None and element.tag == "visual":
                rgba = " ".join(f"{share:.6g}" for share in (*color[:3], 1.0))
                ElementTree.SubElement(ElementTree.SubElement(element, "material"), "color", {"rgba": rgba})
        for path, most in (("inertial/mass", _MAX_MASS), ("contact/lateral_friction", _MAX_FRICTION)):
            parent, element = link.find(path.partition("/")[0]), link.find(path)
            if parent is None or element is None:
                continue
            text = element.get("value", element.text or "")
            try:
                number = float(text)
            except ValueError:
                number = float("nan")
            if 0 <= number <= most:
                element.set("value", text)
                continue
            parent.remove(element)
            stage.notes.append(f"<{element.tag}> {text.strip()[:40]!r} cannot be: it is estimated")
    for material in top.findall("material"):
        top.remove(material)


def _read_urdf_material(
    material: Element, described: dict[str, Element], stage: _Stage
) -> tuple[Floats | None, str | None]:
    """Colour (3,) in 0..1 and picture of a visual; an empty material refers to another by its name."""
    source = material if len(material) else described.get(material.get("name", ""), material)
    color, texture = source.find("color"), source.find("texture")
    rgb: Floats | None = None
    if color is not None:
        try:
            rgb = np.array([float(word) for word in color.get("rgba", "").replace(",", " ").split()][:3])
        except ValueError:
            rgb = np.zeros(0)
        if rgb.shape != (3,) or not ((rgb >= 0) & (rgb <= 255)).all():
            stage.notes.append(f"rgba {color.get('rgba', '')[:60]!r} is no colour")
            rgb = None
        elif rgb.max() > 1:
            rgb = rgb / 255
    return rgb, None if texture is None else stage.find_picture(texture.get("filename", ""))


_MESH_ATTRIBUTES: Final = {
    *("name", "class", "content_type", "file", "vertex", "normal", "texcoord", "face", "material"),
    *("scale", "refpos", "refquat", "inertia", "smoothnormal", "maxhullvert", "octree_maxdepth", "needsdf"),
}
"""Attributes that are applied, or that no shape depends on."""


def _stage_mjcf_meshes(top: Element, stage: _Stage) -> bool:
    """Replace the meshes and materials of an MJCF file by those of the stage. Returns: True if it states the mass."""
    folders = {"meshdir": "", "texturedir": "", "assetdir": ""}
    for compiler in top.findall("compiler"):
        folders |= {name: compiler.attrib.pop(name) for name in folders if name in compiler.attrib}
    mesh_folder, texture_folder = (folders[name] or folders["assetdir"] for name in ("meshdir", "texturedir"))
    defaults = MjcfDefaults(top)
    meshes: dict[str, dict[str, str]] = {}
    for mesh in top.findall("asset/mesh"):
        attributes = defaults.attributes_with_defaults(mesh, "")
        meshes[attributes.get("name") or PurePosixPath(attributes.get("file", "").replace("\\", "/")).stem] = attributes
    textures = {texture.get("name", ""): texture for texture in top.findall("asset/texture")}
    looks: dict[str, tuple[str | None, Element | None]] = {}
    for material in top.findall("asset/material"):
        attributes = defaults.attributes_with_defaults(material, "")
        layers = {layer.get("role", ""): layer.get("texture", "") for layer in material.findall("layer")}
        name = attributes.get("texture") or layers.get("rgb") or layers.get("rgba") or ""
        looks[attributes.get("name", "")] = (attributes.get("rgba"), textures.get(name))
    for world in top.findall("worldbody"):
        for ground in world.findall("geom[@type='plane']"):
            world.remove(ground)  # the floor of a scene is no part of its object
    has_mass, has_inertial = True, top.find(".//inertial") is not None
    for geom, attributes in _iterate_mjcf_geoms(top, defaults):
        kind, mesh_name = attributes.get("type", "sphere"), attributes.get("mesh", "")
        if "fitscale" in attributes or (mesh_name and kind != "mesh"):
            message = f"geom {attributes.get('name', '')!r} fits a {kind} to the mesh {mesh_name!r}"
            raise RefusedError(f"{stage.description}: {message}", 'give it type="mesh", or a size')
        if kind == "mesh" and mesh_name not in meshes:
            message = f"mesh {mesh_name[:60]!r} is not among the assets"
            raise RefusedError(f"{stage.description}: {message}", "name a <mesh> of <asset>")
        mesh = meshes.get(mesh_name, {})
        color, texture = looks.get(attributes.get("material", mesh.get("material", "")), (None, None))
        picture, plain = _read_mjcf_texture(texture, texture_folder, stage)
        if kind == "mesh":
            geom.set("mesh", _stage_mjcf_mesh(mesh_name, mesh, mesh_folder, picture, stage))
            if not has_inertial and "mass" not in attributes:
                geom.set("mass", "0")  # weighed from its volume later
                collides = any(attributes.get(bit, "1") != "0" for bit in ("contype", "conaffinity"))
                has_mass = has_mass and (attributes.get("density") == "0" or not collides)
        elif picture is not None:
            plain = stage.mean_picture_color(picture)
        rgba = attributes.get("rgba", color) if plain is None else " ".join(f"{share:.6g}" for share in (*plain, 1.0))
        if rgba is not None:
            geom.set("rgba", rgba)
    # The materials have been applied: only the staged meshes remain among the assets.
    for parent in [*top.iter("asset"), *top.iter("default")]:
        for element in [*parent.findall("mesh"), *parent.findall("texture"), *parent.findall("material")]:
            parent.remove(element)
    for geom in top.iter("geom"):
        geom.attrib.pop("material", None)
    assets = ElementTree.SubElement(top, "asset")
    for name in stage.meshes:
        ElementTree.SubElement(assets, "mesh", {"name": name, "file": name})
    return has_mass


def _iterate_mjcf_geoms(top: Element, defaults: MjcfDefaults) -> Iterator[tuple[Element, dict[str, str]]]:
    """Every geom of the bodies with its attributes and those of its class."""
    bodies = [(body, "") for body in top.findall("worldbody/body")]
    while bodies:
        body, inherited = bodies.pop()
        kind = body.get("childclass", inherited)
        for geom in body.findall("geom"):
            yield geom, defaults.attributes_with_defaults(geom, kind)
        bodies += [(child, kind) for child in body.findall("body")]


def _read_mjcf_texture(texture: Element | None, folder: str, stage: _Stage) -> tuple[str | None, Floats | None]:
    """The picture of a texture for texture coordinates, else its mean colour (3,)."""
    if texture is None:
        return None, None
    files = [texture.get(name, "") for name in ("file", "fileright", "fileleft", "filefront", "fileup")]
    file = next(filter(None, files), "")
    if not file:
        plain = stage.parse_numbers(texture.get("rgb1", "0.8 0.8 0.8"), "rgb1", (3,))
        if texture.get("builtin", "none") not in ("none", "flat"):
            stage.notes.append(f"the pattern {texture.get('builtin', '')[:20]!r} is shown as its first colour")
        return None, np.clip(np.asarray(plain), 0, 1)
    picture = stage.find_picture(f"{folder}/{file}" if folder else file)
    if picture is None or texture.get("type", "cube") == "2d":
        return picture, None
    return None, stage.mean_picture_color(picture)


def _stage_mjcf_mesh(name: str, attributes: dict[str, str], folder: str, picture: str | None, stage: _Stage) -> str:
    """The file name in the stage of a mesh asset: moved by its reference pose, then scaled, as MuJoCo does."""
    unknown = sorted(set(attributes) - _MESH_ATTRIBUTES)
    if unknown:
        message = f"mesh {name[:60]!r} has {', '.join(unknown)}"
        raise RefusedError(f"{stage.description}: {message}", "give it as a file or as vertices and faces")
    key = (name, picture)
    if key not in stage.names:
        if "vertex" in attributes:
            reading = SourceModel([], notes=[])
            image = stage.read_picture(picture)
            reading.parts.append(_read_inline_mesh(name, attributes, image, stage, reading.notes))
        else:
            file = attributes.get("file", "")
            reading = stage.read_mesh_file(f"{folder}/{file}" if folder else file, picture)
        scale = np.asarray(stage.parse_scale(attributes.get("scale", "1 1 1")))
        position = np.asarray(stage.parse_numbers(attributes.get("refpos", "0 0 0"), "refpos", (3,)))
        w, x, y, z = stage.parse_numbers(attributes.get("refquat", "1 0 0 0"), "refquat", (4,))
        length = float(np.linalg.norm((w, x, y, z)))
        if length < 1e-9:
            raise RefusedError(f"{stage.description}: refquat of mesh {name[:60]!r} is zero", "give a rotation")
        turn = matrix_from_quaternion((x / length, y / length, z / length, w / length)).T
        moved = [_place_part(part, np.ones(3), turn, -turn @ position) for part in reading.parts]
        parts = [_place_part(part, scale, np.eye(3), np.zeros(3)) for part in moved]
        stage.names[key] = stage.stage_parts(parts, reading.notes)
    return stage.names[key]


def _read_inline_mesh(
    name: str, attributes: dict[str, str], image: Image | None, stage: _Stage, notes: list[str]
) -> MeshPart:
    """A mesh that an MJCF file writes out; without faces it is the convex hull of its vertices."""
    points, numbers, coordinates = (
        np.asarray(stage.parse_numbers(attributes.get(key, ""), f"{key} of mesh {name[:60]!r}", None))
        for key in ("vertex", "face", "texcoord")
    )
    count = len(points) // 3
    sound = len(points) % 3 == 0 and count >= 4 and len(numbers) % 3 == 0 and len(coordinates) in (0, 2 * count)
    if not sound or (len(numbers) and not (0 <= numbers.min() <= numbers.max() < count)):
        counts = (
            f"{len(points)} numbers of vertices, {len(numbers)} of faces and {len(coordinates)} of texture coordinates"
        )
        message = f"{stage.description}: mesh {name[:60]!r} has {counts}, which do not fit"
        raise RefusedError(message, "give 3 numbers for each vertex and face, and 2 for each texture coordinate")
    vertices = points.reshape(-1, 3)
    if len(numbers):
        faces = numbers.astype(np.int64).reshape(-1, 3)
        flat = coordinates.reshape(-1, 2) * (1, -1) + (0, 1)
        uvs = flat[faces] if len(coordinates) else None
    else:
        hull = compute_convex_hull(vertices)
        vertices, faces, uvs = hull.vertices, hull.faces, None
    return build_mesh_part(vertices, faces, uvs, image, None, f"mesh {name[:60]!r}", notes)


def _build_source_model(
    model: ObjectModel, stage: _Stage, has_mass: bool, has_friction: bool, max_parts: int
) -> SourceModel:
    """Visuals and colliders of an object; its meshes collide as at most ``max_parts`` hulls each."""
    colliders: list[Collider] = []
    seen = [shape.mesh or "" for shape in model.visuals]
    notes = [*stage.notes, *(note for mesh in seen for note in stage.notes_by_mesh.get(mesh, ()))]
    for shape in model.colliders:
        if shape.kind == "mesh":
            vertices, faces = concatenate_mesh_parts(_shape_to_mesh_parts(shape, stage.meshes))
            if max_parts == 1:
                colliders.append(compute_convex_hull(vertices, MAX_VERTICES))
                continue
            hulls, more = decompose_into_convex_parts(vertices, faces, False, max_parts)
            colliders += hulls
            notes += more
        else:
            colliders.append(shape.model_copy(update={"color": None, "texture": None}))
    parts: list[MeshPart] = []
    for shape in model.visuals:
        for part in _shape_to_mesh_parts(shape, stage.meshes):
            colors = part.colors
            if part.image is None and (shape.color is not None or colors is None):  # the description's colour wins
                rgb = np.rint(np.array((shape.color or _GREY)[:3]) * 255).astype(np.uint8)
                colors = np.tile(rgb, (len(part.faces), 1))
            parts.append(replace(part, colors=colors))
    mass = None
    if has_mass and model.mass > 0:
        mass = Quantity(value=model.mass, provenance="catalogue", deviation=0.1)
    friction = Quantity(value=model.friction, provenance="catalogue", deviation=0.2) if has_friction else None
    notes = list(dict.fromkeys(notes))
    return SourceModel(
        parts=parts, colliders=colliders or None, unit="m", up="z", mass=mass, friction=friction, notes=notes
    )


def _shape_to_mesh_parts(shape: Shape, meshes: dict[str, list[MeshPart]]) -> list[MeshPart]:
    """The triangles of a shape in the object's frame."""
    turn, position = matrix_from_quaternion(shape.quaternion), np.asarray(shape.position)
    if shape.kind == "mesh":
        return [_place_part(part, np.asarray(shape.size), turn, position) for part in meshes[shape.mesh or ""]]
    corners = triangulate_primitive(shape).corners
    part = MeshPart(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return [_place_part(part, np.ones(3), turn, position)]


def _place_part(part: MeshPart, scale: Floats, turn: Floats, position: Floats) -> MeshPart:
    """Scale, turn, then move a part; the faces of a mirrored part are flipped to keep their outside."""
    faces, uvs = part.faces, part.uvs
    if np.prod(scale) < 0:
        faces, uvs = faces[:, ::-1], None if uvs is None else uvs[:, ::-1]
    return MeshPart(part.vertices * scale @ turn.T + position, faces, uvs, part.image, part.colors)
