"""Reading URDF and MJCF of one rigid object with meshes of any format: staged as OBJ for the library's readers."""

import tempfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from grs_agents.errors import InputError
from grs_agents.library.asset import Quantity
from grs_agents.library.formats.mjcf import read_mjcf
from grs_agents.library.formats.model_file import parse, read_text
from grs_agents.library.formats.urdf import read_urdf
from grs_agents.library.importing.convex_parts import convex_parts, hull_of
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.source_folder import Folder
from grs_agents.library.importing.types import (
    Collider,
    Floats,
    Hull,
    ImportOptions,
    Item,
    Part,
    Reading,
    RefusedError,
)
from grs_agents.library.mesh_files import solid_surface
from grs_agents.library.shapes import ObjectModel, Shape, rotation_matrix

_GREY = (0.7, 0.7, 0.7, 1.0)
Staged = dict[str, list[Part]]
"""The parts of each staged mesh, by its file name in the staging folder."""


def read_described(folder: Folder, item: Item, options: ImportOptions) -> Reading:
    """What a URDF or MJCF file says, in metres with z up.

    Raises:
        RefusedError: the file or a mesh of it is broken or names what it must not.
    """
    path = folder.path(item.file)

    def fault(message: str, remedy: str) -> InputError:
        return RefusedError(f"{item.file}: {message}", remedy)

    with tempfile.TemporaryDirectory(prefix="grs-import-") as name:
        stage = Path(name)
        try:
            top = parse(read_text(path), fault)
            staged = (_stage_mjcf if item.kind == "mjcf" else _stage_urdf)(top, folder, item.file, stage, options)
            target = stage / f"object{'.xml' if item.kind == 'mjcf' else '.urdf'}"
            target.write_bytes(ElementTree.tostring(top))
            model = read_mjcf(target, stage) if item.kind == "mjcf" else read_urdf(target, stage)
        except RefusedError:
            raise
        except InputError as error:
            raise RefusedError(f"{item.file}: {error.message.replace(name, '').lstrip('/')}", error.remedy) from error
    return _reading(model, staged, _says_friction(top), decompose=item.kind == "urdf", parts=options.parts)


def _reading(model: ObjectModel, staged: Staged, friction: bool, *, decompose: bool, parts: int) -> Reading:
    visuals = [part for shape in model.visuals for part in _parts_of(shape, staged)]
    colliders: list[Collider] = []
    notes: list[str] = []
    for shape in model.colliders:
        if shape.kind != "mesh":
            colliders.append(shape.model_copy(update={"color": None, "texture": None}))
            continue
        hulls, told = _hulls(shape, staged, parts if decompose else 1)
        colliders += hulls
        notes += told
    return Reading(
        parts=visuals,
        colliders=colliders or None,
        unit="m",
        up="z",
        mass=Quantity(value=model.mass, provenance="catalogue", deviation=0.1) if model.mass > 0 else None,
        friction=Quantity(value=model.friction, provenance="catalogue", deviation=0.2) if friction else None,
        notes=notes,
    )


def _says_friction(top: Element) -> bool:
    """Whether the file gives a friction, rather than leaving it to a default."""
    return any("friction" in one.attrib or one.tag == "lateral_friction" for one in top.iter())


def _parts_of(shape: Shape, staged: Staged) -> list[Part]:
    turn, position = rotation_matrix(shape.quaternion), np.asarray(shape.position)
    if shape.kind != "mesh":
        corners = solid_surface(shape).corners
        plain = Part(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        return [_colored(_moved(plain, np.ones(3), turn, position), shape)]
    found = staged[shape.mesh or ""]
    return [_colored(_moved(part, np.asarray(shape.size), turn, position), shape) for part in found]


def _moved(part: Part, scale: Floats, turn: Floats, position: Floats) -> Part:
    return Part(part.vertices * scale @ turn.T + position, part.faces, part.uvs, part.image, part.colors)


def _colored(part: Part, shape: Shape) -> Part:
    """A description's own colour goes over what a mesh without a picture says."""
    if part.image is not None or (shape.color is None and part.colors is not None):
        return part
    rgb = np.rint(np.array((shape.color or _GREY)[:3]) * 255).astype(np.uint8)
    return Part(part.vertices, part.faces, part.uvs, part.image, np.tile(rgb, (len(part.faces), 1)))


def _hulls(shape: Shape, staged: Staged, most: int) -> tuple[list[Hull], list[str]]:
    found = [
        _moved(part, np.asarray(shape.size), rotation_matrix(shape.quaternion), np.asarray(shape.position))
        for part in staged[shape.mesh or ""]
    ]
    counts = np.cumsum([0, *(len(part.vertices) for part in found)])
    vertices = np.concatenate([part.vertices for part in found])
    if most == 1:
        return [hull_of(vertices, 64)], []
    faces = np.concatenate([part.faces + start for part, start in zip(found, counts[:-1], strict=True)])
    return convex_parts(vertices, faces, False, most)


def _stage_urdf(top: Element, folder: Folder, file: str, stage: Path, options: ImportOptions) -> Staged:
    staged: Staged = {}
    for mesh in top.iter("mesh"):
        name = _package(mesh.get("filename", ""), folder, file)
        path = folder.path(name, file)
        mesh.set("filename", _staged(staged, stage, _reader(folder, folder.relative(path), None, options)))
    textures = {id(one) for one in top.iter("texture")}
    for material in top.iter("material"):
        for texture in [one for one in material if id(one) in textures]:
            folder.path(_package(texture.get("filename", ""), folder, file), file)
            material.remove(texture)  # a mesh brings its own picture
    return staged


def _package(name: str, folder: Folder, file: str) -> str:
    """A file name without ``package://NAME/`` and ``file://``, relative to the URDF."""
    if name.startswith("file://"):
        name = name.removeprefix("file://")
    if not name.startswith("package://"):
        return name
    rest = name.removeprefix("package://")
    levels = len(PurePosixPath(file).parts) - 1
    tails = (rest, rest.partition("/")[2])
    options = ["../" * level + tail for tail in tails for level in range(levels + 1)]
    return next((one for one in options if one and ((folder.root / file).parent / one).is_file()), tails[1] or rest)


def _stage_mjcf(top: Element, folder: Folder, file: str, stage: Path, options: ImportOptions) -> Staged:
    compiler = {name: value for one in top.findall("compiler") for name, value in one.attrib.items()}
    meshes, textures = (
        _prefix(compiler.get(f"{kind}dir", compiler.get("assetdir", ""))) for kind in ("mesh", "texture")
    )
    for one in top.findall("compiler"):
        for name in ("meshdir", "texturedir", "assetdir"):
            one.attrib.pop(name, None)
    pictures = {one.get("name", ""): one.get("file", "") for one in top.findall("asset/texture")}
    materials = {one.get("name", ""): pictures.get(one.get("texture", ""), "") for one in top.findall("asset/material")}
    shown = {geom.get("mesh", ""): materials.get(geom.get("material", ""), "") for geom in top.iter("geom")}
    staged: Staged = {}
    for mesh in top.findall("asset/mesh"):
        said = mesh.get("file", "")
        name = mesh.get("name") or PurePosixPath(said).stem
        path = folder.path(meshes + said, file)
        picture = shown.get(name, "")
        texture = folder.relative(folder.path(textures + picture, file)) if picture else None
        mesh.set("name", name)
        mesh.set("file", _staged(staged, stage, _reader(folder, folder.relative(path), texture, options)))
    if top.find(".//inertial") is None:
        for geom in top.iter("geom"):
            if geom.get("type") == "mesh" and "mass" not in geom.attrib:
                geom.set("mass", "0")  # weighed from its volume later
    return staged


def _prefix(folder: str) -> str:
    return f"{folder.rstrip('/')}/" if folder else ""


def _reader(folder: Folder, name: str, texture: str | None, options: ImportOptions) -> Callable[[], Reading]:
    return lambda: read_mesh(folder, name, options.limits, texture)


def _staged(staged: Staged, stage: Path, read: Callable[[], Reading]) -> str:
    """Read a mesh and write its shape as an OBJ into the staging folder; returns the file's name there."""
    reading, name = read(), f"mesh{len(staged)}.obj"
    turn = np.eye(3) if reading.up != "y" else np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    staged[name] = [_moved(part, np.ones(3), turn, np.zeros(3)) for part in reading.parts]
    lines: list[str] = []
    start = 1
    for part in staged[name]:
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in part.vertices.tolist()]
        lines.append(f"f {start} {start + 1} {start + 2}")
        start += len(part.vertices)
    (stage / name).write_text("\n".join([*lines, ""]), encoding="utf-8")
    return name
