"""Reading MJCF: the single object of a MuJoCo file, of boxes, cylinders, capsules, spheres and meshes.

As for URDF, nothing is run or included, no file outside the library root is opened, and unknown elements are refused by
name. A body with its children, which must not move against it, forms the object; it may have a free joint. Default
classes count for geoms and meshes. A capsule becomes the cylinder of its length. Geoms without collisions (contype =
conaffinity = 0) are visuals; without such geoms the colliders are shown.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.library.formats.model_file import ModelFile, read_text
from grs_agents.library.shapes import (
    IDENTITY_PLACEMENT,
    ObjectModel,
    Placement,
    Rgba,
    Shape,
    ShapeKind,
    shape_volume,
)

_MAX_ANGLE = 1000.0
"""Degrees, or radians, of an angle at most."""
_ORIGIN: Vec3 = (0.0, 0.0, 0.0)


class Frames:
    """Reads placements by a file's ``<compiler>`` attributes ``angle`` and ``eulerseq``."""

    def __init__(self, source: ModelFile, compiler: Mapping[str, str]) -> None:
        self.source = source
        self.unit = 1.0 if compiler.get("angle", "degree") == "radian" else math.pi / 180
        self.sequence = compiler.get("eulerseq", "xyz")
        if compiler.get("coordinate", "local") != "local":
            raise source.make_error("global coordinates", "give every position in its parent's frame")
        if len(self.sequence) != 3 or any(letter not in "xyzXYZ" for letter in self.sequence):
            raise source.make_error(f"eulerseq {self.sequence!r}", "give three of the letters x y z X Y Z")

    def read_placement(self, attributes: Mapping[str, str]) -> Placement:
        """Position and rotation of a body or geom with these attributes."""
        x, y, z = self.source.parse_n_numbers(attributes.get("pos", "0 0 0"), "pos", 3)
        return (x, y, z), self._read_rotation(attributes)

    def parse_fromto(self, text: str) -> tuple[float, Placement]:
        """Length of a ``fromto`` and the placement whose z axis runs along it from its middle."""
        start, end = np.array(self.source.parse_n_numbers(text, "fromto", 6)).reshape(2, 3)
        length = float(np.linalg.norm(end - start))
        if length < 1e-6:
            raise self.source.make_error(f"fromto {text[:80]!r} has no length", "give two different points")
        x, y, z = (float(value) for value in (start + end) / 2)
        return length, ((x, y, z), _quaternion_from_z_axis((end - start) / length))

    def _read_rotation(self, attributes: Mapping[str, str]) -> Quat:
        if "xyaxes" in attributes:
            raise self.source.make_error("xyaxes is not read", "write the rotation as quat or euler")
        if "quat" in attributes:
            w, x, y, z = self._normalize_vector(self.source.parse_n_numbers(attributes["quat"], "quat", 4), "quat")
            return (x, y, z, w)
        if "axisangle" in attributes:
            *axis, angle = self.source.parse_n_numbers(attributes["axisangle"], "axisangle", 4, _MAX_ANGLE)
            return _axis_angle_quaternion(np.array(self._normalize_vector(tuple(axis), "axisangle")), angle * self.unit)
        if "zaxis" in attributes:
            axis = self.source.parse_n_numbers(attributes["zaxis"], "zaxis", 3)
            return _quaternion_from_z_axis(np.array(self._normalize_vector(axis, "zaxis")))
        if "euler" in attributes:
            # Lower-case letters turn about the moving axes, capitals about the fixed axes.
            angles = self.source.parse_n_numbers(attributes["euler"], "euler", 3, _MAX_ANGLE)
            total = IDENTITY_PLACEMENT
            for letter, angle in zip(self.sequence, angles, strict=True):
                axis = np.eye(3)["xyz".index(letter.lower())]
                turn: Placement = (_ORIGIN, _axis_angle_quaternion(axis, angle * self.unit))
                total = (
                    transforms.compose_poses(total, turn) if letter.islower() else transforms.compose_poses(turn, total)
                )
            return total[1]
        return IDENTITY_PLACEMENT[1]

    def _normalize_vector(self, numbers: tuple[float, ...], name: str) -> tuple[float, ...]:
        length = math.sqrt(sum(number * number for number in numbers))
        if length < 1e-9:
            raise self.source.make_error(f"{name} {numbers} has no direction", "give a vector that is not zero")
        return tuple(number / length for number in numbers)


def _axis_angle_quaternion(axis: np.ndarray[tuple[int], np.dtype[np.float64]], angle: float) -> Quat:
    x, y, z = (float(value) * math.sin(angle / 2) for value in axis)
    return (x, y, z, math.cos(angle / 2))


def _quaternion_from_z_axis(direction: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Quat:
    """The smallest rotation that takes z to ``direction`` (unit)."""
    x, y, z = (float(value) for value in direction)
    if z < -1 + 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    length = math.sqrt((1 + z) ** 2 + x * x + y * y)
    return (-y / length, x / length, 0.0, (1 + z) / length)


class MjcfDefaults:
    """Attributes of geoms, meshes and materials by the ``<default>`` classes of a file."""

    def __init__(self, top: Element) -> None:
        self._classes: dict[tuple[str, str], dict[str, str]] = {}
        for default in top.findall("default"):
            self._collect_class_defaults(default, {})

    def _collect_class_defaults(self, default: Element, inherited: dict[str, dict[str, str]]) -> None:
        merged = {tag: dict(inherited.get(tag, {})) for tag in ("geom", "mesh", "material")}
        for tag, attributes in merged.items():
            for element in default.findall(tag):
                attributes.update(element.attrib)
            self._classes[default.get("class", "main"), tag] = attributes
        for inner in default.findall("default"):
            self._collect_class_defaults(inner, merged)

    def attributes_with_defaults(self, element: Element, inherited: str) -> dict[str, str]:
        """An element's attributes over those of its class, else of the class ``inherited``, else of ``main``."""
        return {**self._classes.get((element.get("class", inherited) or "main", element.tag), {}), **element.attrib}


_REFUSED = ("include", "plugin", "extension", "attach", "model", "replicate", "composite", "flexcomp", "frame")
_FRICTION, _DENSITY = 1.0, 1000.0


@dataclass(frozen=True)
class _Geom:
    shape: Shape
    collides: bool
    mass: float | None
    friction: float


def read_mjcf(path: Path, root: Path) -> ObjectModel:
    """Read the single object of an MJCF file; its frame is that of the outermost body.
    Raises InputError: it is not MJCF of a single rigid object with files below ``root``; names the fault."""
    return _Reader(ModelFile(read_text(path), str(path), root, path.parent)).build_object_model()


class _Reader:
    """A single pass over a file."""

    def __init__(self, source: ModelFile) -> None:
        self.source, top = source, source.top
        if source.top.tag != "mujoco":
            raise source.make_error(f"<{source.top.tag}> is not MJCF", "give a <mujoco> file")
        for element in source.top.iter():
            if element.tag in _REFUSED:
                raise source.make_error(f"<{element.tag}> is refused", "write out what it stands for")
        self.defaults = MjcfDefaults(source.top)
        compiler = {name: text for element in source.top.findall("compiler") for name, text in element.attrib.items()}
        self.frames = Frames(source, compiler)
        self.folder = compiler.get("meshdir", compiler.get("assetdir", ""))
        self.material_colors: dict[str, Rgba] = {
            material.get("name", ""): source.parse_rgba(material.attrib["rgba"])
            for material in source.top.findall("asset/material[@rgba]")
        }
        self.meshes = {mesh.get("name") or Path(mesh.get("file", "")).stem: mesh for mesh in top.findall("asset/mesh")}

    def build_object_model(self) -> ObjectModel:
        """The object."""
        bodies, loose = self.source.top.findall("worldbody/body"), self.source.top.findall("worldbody/geom")
        if len(bodies) != 1 or loose:
            message = f"{len(bodies)} bodies and {len(loose)} loose geoms in <worldbody>"
            raise self.source.make_error(message, "give exactly one <body> that holds every geom")
        weights: list[float] = []
        geoms = list(self._read_body_geoms(bodies[0], IDENTITY_PLACEMENT, "", weights, True))
        frictions = [geom.friction for geom in geoms if geom.collides]
        colliders = [geom.shape for geom in geoms if geom.collides]
        visuals = [geom.shape for geom in geoms if not geom.collides]
        if not weights:
            unweighed = next((geom for geom in geoms if geom.mass is None and geom.collides), None)
            if unweighed is not None:
                remedy = "give the geom a mass or the body an <inertial>"
                raise self.source.make_error(f"mesh geom {unweighed.shape.mesh!r} has no mass", remedy)
            weights = [geom.mass or 0.0 for geom in geoms]
        friction = [*frictions, _FRICTION][0]
        return self.source.build_object_model(visuals or colliders, colliders, sum(weights), friction)

    def _read_body_geoms(
        self, body: Element, place: Placement, inherited: str, weights: list[float], top: bool
    ) -> Iterator[_Geom]:
        name, kind = body.get("name", ""), body.get("childclass", inherited)
        for joint in body.findall("joint"):
            if not (top and joint.get("type") == "free"):
                named = f"joint {joint.get('name', '')!r} of body {name!r} is a {joint.get('type', 'hinge')}"
                raise self.source.make_error(named, "remove it: an object is one rigid thing")
        if body.findall("freejoint") and not top:
            raise self.source.make_error(f"body {name!r} is free inside another one", "keep one object in one file")
        for inertial in body.findall("inertial"):
            weights.append(self._parse_nonnegative(inertial.get("mass", ""), "<inertial> mass"))
        for geom in body.findall("geom"):
            yield self._read_geom(self.defaults.attributes_with_defaults(geom, kind), place)
        for child in body.findall("body"):
            inner = transforms.compose_poses(place, self.frames.read_placement(child.attrib))
            yield from self._read_body_geoms(child, inner, kind, weights, False)

    def _read_geom(self, attributes: dict[str, str], place: Placement) -> _Geom:
        name, kind, paint = attributes.get("name", ""), attributes.get("type", "sphere"), attributes.get("material", "")
        mesh, size, local = None, (), self.frames.read_placement(attributes)
        if kind == "mesh":
            mesh_name = attributes.get("mesh", "")
            if mesh_name not in self.meshes:
                raise self.source.make_error(f"mesh {mesh_name!r} is not among the assets", "name a <mesh> of <asset>")
            asset = self.defaults.attributes_with_defaults(self.meshes[mesh_name], "")
            for refused in ("vertex", "refpos", "refquat", "builtin"):
                if refused in asset:
                    raise self.source.make_error(
                        f"mesh {mesh_name!r} has {refused}", "give it as a file in its own frame"
                    )
            scale = self.source.parse_n_numbers(asset.get("scale", "1 1 1"), "<mesh> scale", 3)
            file = self.source.resolve_library_file(asset.get("file", ""), self.folder)
            mesh, size = file, self.source.require_positive(scale, "<mesh> scale")
        elif kind in ("box", "sphere", "cylinder", "capsule"):
            size, local = self._read_geom_size(kind, attributes, local)
        else:
            raise self.source.make_error(f"geom {name!r} is a {kind}", "use box, sphere, cylinder, capsule or mesh")
        kinds: dict[str, ShapeKind] = {"box": "box", "sphere": "sphere", "mesh": "mesh"}
        at, turn = transforms.compose_poses(place, local)
        friction = self.source.parse_numbers(attributes.get("friction", f"{_FRICTION}"), "friction")
        color = self.source.parse_rgba(attributes["rgba"]) if "rgba" in attributes else self.material_colors.get(paint)
        shape = Shape(kind=kinds.get(kind, "cylinder"), size=size, position=at, quaternion=turn, color=color, mesh=mesh)
        collides = any(self._parse_nonnegative(attributes.get(bit, "1"), bit) for bit in ("contype", "conaffinity"))
        if "mass" in attributes:
            mass = self._parse_nonnegative(attributes["mass"], "mass")
        else:  # by density; the volume of a mesh is not measured
            density = self._parse_nonnegative(attributes.get("density", f"{_DENSITY}"), "density", 1e5)
            mass = 0.0 if density == 0 else None if kind == "mesh" else density * shape_volume(shape)
        return _Geom(shape, collides, mass, friction[0] if friction else _FRICTION)

    def _read_geom_size(
        self, kind: str, attributes: dict[str, str], local: Placement
    ) -> tuple[tuple[float, ...], Placement]:
        """The size of a primitive as `Shape` gives it (MJCF's sizes are halves), and its placement."""
        words = self.source.parse_numbers(attributes.get("size", ""), f"<geom> size of a {kind}")
        length: float | None = None
        if "fromto" in attributes and kind != "sphere":
            length, local = self.frames.parse_fromto(attributes["fromto"])
        needed = {"box": 3, "sphere": 1}.get(kind, 2 if length is None else 1)
        if len(words) < needed or (kind == "box" and length is not None):
            remedy = f"give {needed} numbers, and no fromto for a box"
            raise self.source.make_error(f"<geom> size {words} of a {kind}", remedy)
        if kind == "box":
            size = tuple(2 * half for half in words[:3])
        elif kind == "sphere":
            size = words[:1]
        else:
            length = 2 * words[1] if length is None else length
            size = (words[0], length + (2 * words[0] if kind == "capsule" else 0.0))
        return self.source.require_positive(size, f"<geom> size of a {kind}"), local

    def _parse_nonnegative(self, text: str, name: str, most: float = 1e3) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0 <= number <= most:
            raise self.source.make_error(f"{name} is {text[:40]!r}", f"give a number from 0 to {most:g}")
        return number
