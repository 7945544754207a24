"""Reading URDF: one rigid link of boxes, cylinders, spheres and meshes.

The files may come from users, so the reader trusts nothing: no document types or entities, no file outside
the library root, no number that is not finite, no size that is not positive.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from grs_agents.base import Vec3
from grs_agents.errors import InputError
from grs_agents.library.mesh_file import read_vertices
from grs_agents.library.shapes import (
    ObjectModel,
    Rgba,
    Shape,
    quaternion_from_rpy,
    shape_bounds,
    union_bounds,
)

_MAX_BYTES, _MAX_DEPTH, _MAX_SHAPES, _MAX_METRES = 1_000_000, 32, 500, 100.0
_DEFAULT_FRICTION = 0.5
_LOOK = tuple[Rgba | None, str | None]


def read_urdf(source: Path | str, root: Path, folder: str = "") -> ObjectModel:
    """What a URDF says.

    Args:
        source: the file (a ``Path``) or the XML text (a ``str``).
        root: the library root; every file the URDF names must lie inside it.
        folder: for XML text: the folder below ``root`` that its file names are relative to.

    Raises:
        InputError: the file or text is not a URDF of one rigid link that we can trust; names the fault.
    """
    if isinstance(source, Path):
        return _Reader(_text(source), str(source), root, source.parent).model()
    return _Reader(source, "URDF text", root, root / folder).model()


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path} is larger than {_MAX_BYTES} bytes", "split or simplify the URDF")
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {error}", "give a URDF file in UTF-8") from error


class _Reader:
    """One pass over one URDF, so that every error can name where it came from."""

    def __init__(self, text: str, where: str, root: Path, folder: Path) -> None:
        self.where, self.root, self.folder = where, root.resolve(), folder
        self.robot = self._parse(text)
        self.looks = {material.get("name", ""): self._own_look(material) for material in self.robot.findall("material")}

    def fault(self, message: str, remedy: str = "correct the URDF") -> InputError:
        """The error for something wrong in this URDF."""
        return InputError(f"{self.where}: {message}", remedy)

    def model(self) -> ObjectModel:
        """The object the URDF describes."""
        links = self.robot.findall("link")
        if self.robot.tag != "robot" or len(links) != 1:
            raise self.fault(f"<{self.robot.tag}> with {len(links)} links", "give a <robot> of exactly one <link>")
        link = links[0]
        visuals = tuple(self._shapes(link, "visual"))
        colliders = tuple(self._shapes(link, "collision"))
        if not visuals and not colliders:
            raise self.fault("neither visual nor collision", "add at least one shape")
        solids = colliders or visuals
        bounds = union_bounds(shape_bounds(shape, self._vertices(shape)) for shape in solids)
        return ObjectModel(
            visuals=visuals or colliders,
            colliders=colliders,
            mass=self._scalar(link.find("inertial/mass"), 0.0),
            friction=self._scalar(link.find("contact/lateral_friction"), _DEFAULT_FRICTION),
            bounds=bounds,
        )

    def _parse(self, text: str) -> ElementTree.Element:
        if len(text) > _MAX_BYTES:
            raise self.fault(f"longer than {_MAX_BYTES} characters", "split or simplify the URDF")
        guard, depth = expat.ParserCreate(), 0

        def refuse(*_: object) -> None:
            raise self.fault("document types and entities are refused", "remove <!DOCTYPE ...>")

        def enter(tag: str, _: dict[str, str]) -> None:
            nonlocal depth
            depth += 1
            if depth > _MAX_DEPTH:
                raise self.fault(f"<{tag}> is nested deeper than {_MAX_DEPTH}")

        def leave(_: str) -> None:
            nonlocal depth
            depth -= 1

        guard.StartDoctypeDeclHandler = refuse
        guard.EntityDeclHandler = refuse
        guard.StartElementHandler, guard.EndElementHandler = enter, leave
        try:
            guard.Parse(text, True)
            return ElementTree.fromstring(text)
        except (expat.ExpatError, ElementTree.ParseError, ValueError) as error:
            raise self.fault(f"not XML: {error}") from error

    def _shapes(self, link: ElementTree.Element, tag: str) -> Iterator[Shape]:
        elements = link.findall(tag)
        if len(elements) > _MAX_SHAPES:
            raise self.fault(f"{len(elements)} <{tag}> elements, at most {_MAX_SHAPES} are allowed")
        for element in elements:
            yield self._shape(element, tag)

    def _shape(self, element: ElementTree.Element, tag: str) -> Shape:
        geometries = list(element.findall("geometry/*"))
        if len(geometries) != 1:
            raise self.fault(f"<{tag}> has {len(geometries)} shapes in <geometry>", "give exactly one")
        geometry, origin = geometries[0], element.find("origin")
        color, texture = self._look(element.find("material")) if tag == "visual" else (None, None)
        mesh: str | None = None
        size: tuple[float, ...]
        if geometry.tag == "box":
            kind, size = "box", self._sizes(geometry, "size", 3)
        elif geometry.tag == "cylinder":
            kind, size = (
                "cylinder",
                (*self._sizes(geometry, "radius", 1), *self._sizes(geometry, "length", 1)),
            )
        elif geometry.tag == "sphere":
            kind, size = "sphere", self._sizes(geometry, "radius", 1)
        elif geometry.tag == "mesh":
            kind, mesh = "mesh", self._file(geometry.get("filename", ""))
            size = self._sizes(geometry, "scale", 3) if "scale" in geometry.attrib else (1.0, 1.0, 1.0)
        else:
            raise self.fault(f"unknown shape <{geometry.tag}>", "use box, cylinder, sphere or mesh")
        roll, pitch, yaw = self._vector(origin, "rpy")
        return Shape(
            kind=kind,
            size=size,
            position=self._vector(origin, "xyz"),
            quaternion=quaternion_from_rpy(roll, pitch, yaw),
            color=color,
            mesh=mesh,
            texture=texture,
        )

    def _look(self, material: ElementTree.Element | None) -> _LOOK:
        if material is None:
            return None, None
        color, texture = self._own_look(material)
        named_color, named_texture = self.looks.get(material.get("name", ""), (None, None))
        return color or named_color, texture or named_texture

    def _own_look(self, material: ElementTree.Element) -> _LOOK:
        color, texture = material.find("color"), material.find("texture")
        rgba: Rgba | None = None
        if color is not None:
            numbers = self._numbers(color.get("rgba", ""), "rgba", 4)
            if min(numbers) < 0 or max(numbers) > 1:
                raise self.fault(f"rgba {numbers} is outside 0..1")
            rgba = (numbers[0], numbers[1], numbers[2], numbers[3])
        return rgba, None if texture is None else self._file(texture.get("filename", ""))

    def _file(self, name: str) -> str:
        if not name or ":" in name or "\\" in name or "\0" in name or name.startswith("/"):
            raise self.fault(f"file name {name!r}", "name a file relative to the URDF's folder")
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.root):
            raise self.fault(f"file name {name!r} leaves the library {self.root}", "keep files inside the library")
        if not path.is_file():
            raise self.fault(f"file {name!r} does not exist", f"put it at {path}")
        return path.relative_to(self.root).as_posix()

    def _vertices(self, shape: Shape) -> np.ndarray[tuple[int, int], np.dtype[np.float64]] | None:
        return None if shape.mesh is None else read_vertices(self.root / shape.mesh)

    def _vector(self, element: ElementTree.Element | None, name: str) -> Vec3:
        if element is None or name not in element.attrib:
            return (0.0, 0.0, 0.0)
        x, y, z = self._numbers(element.attrib[name], name, 3)
        return (x, y, z)

    def _sizes(self, element: ElementTree.Element, name: str, count: int) -> tuple[float, ...]:
        numbers = self._numbers(element.get(name, ""), f"<{element.tag}> {name}", count)
        if min(numbers) <= 0:
            raise self.fault(f"<{element.tag}> {name} {numbers} is not positive", "give sizes in metres above 0")
        return numbers

    def _scalar(self, element: ElementTree.Element | None, default: float) -> float:
        if element is None:
            return default
        (number,) = self._numbers(element.get("value", ""), f"<{element.tag}> value", 1)
        if number < 0:
            raise self.fault(f"<{element.tag}> value {number} is negative", "give 0 or more")
        return number

    def _numbers(self, text: str, name: str, count: int) -> tuple[float, ...]:
        try:
            numbers = tuple(float(word) for word in text.split())
        except ValueError:
            remedy = "give numbers; a template's placeholders must be filled first"
            raise self.fault(f"{name} is {text[:80]!r}", remedy) from None
        if len(numbers) != count:
            raise self.fault(f"{name} has {len(numbers)} numbers", f"give {count}")
        if not all(math.isfinite(number) and abs(number) <= _MAX_METRES for number in numbers):
            raise self.fault(f"{name} {text[:80]!r} is not finite or beyond {_MAX_METRES:g}")
        return numbers
