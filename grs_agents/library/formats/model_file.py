"""Reads one model description with care: every error names its file, and nothing leaves the library.

XML may come from strangers: it is bounded in length and depth, without document types, entities or inclusions.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from grs_agents import foreign
from grs_agents.base import Vec3
from grs_agents.errors import InputError
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel, Shape, shape_bounds, union_bounds

MAX_BYTES, MAX_DEPTH = 1_000_000, 32

Fault = Callable[[str, str], InputError]
"""The error for a message and a remedy, telling which file they are about."""


def read_text(path: Path) -> str:
    """The text of a small UTF-8 file.

    Raises:
        InputError: it cannot be read or is too large.
    """
    return foreign.read_text(path, "give a small file in UTF-8", MAX_BYTES)


def parse(text: str, fault: Fault) -> ElementTree.Element:
    """The root element of ``text``.

    Raises:
        InputError: it is not XML, or XML that we do not trust.
    """
    if len(text) > MAX_BYTES:
        raise fault(f"longer than {MAX_BYTES} characters", "split or simplify the file")
    guard, depth = expat.ParserCreate(), 0

    def refuse(*_: object) -> None:
        raise fault("document types and entities are refused", "remove <!DOCTYPE ...>")

    def enter(tag: str, _: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if tag.rpartition(":")[2] == "include":
            raise fault(f"<{tag}> is refused", "put what it includes into the file")
        if depth > MAX_DEPTH:
            raise fault(f"<{tag}> is nested deeper than {MAX_DEPTH}", "simplify the file")

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
        raise fault(f"not XML: {error}", "correct the file") from error


def refuse_doctype(data: bytes, fault: Fault, depth: int = 64) -> None:
    """Check XML of any length that another reader is to read: no document types, no entities, not too deep.

    Raises:
        InputError: it is not XML, or XML that we do not trust.
    """
    guard, open_tags = expat.ParserCreate(), 0

    def refuse(*_: object) -> None:
        raise fault("document types and entities are refused", "remove <!DOCTYPE ...>")

    def enter(tag: str, _: dict[str, str]) -> None:
        nonlocal open_tags
        open_tags += 1
        if open_tags > depth:
            raise fault(f"<{tag}> is nested deeper than {depth}", "simplify the file")

    def leave(_: str) -> None:
        nonlocal open_tags
        open_tags -= 1

    guard.StartDoctypeDeclHandler = refuse
    guard.EntityDeclHandler = refuse
    guard.StartElementHandler, guard.EndElementHandler = enter, leave
    try:
        guard.Parse(data, True)
    except (expat.ExpatError, ValueError) as error:
        raise fault(f"not XML: {error}", "correct the file") from error


MAX_SHAPES, MAX_METRES, MAX_PARTS = 500, 100.0, 64


class Source:
    """The XML of one file and the folder that its file names are relative to.

    Args:
        text: the XML.
        where: what errors call it.
        root: the library root; every file it names must lie inside.
        folder: the folder it lies in.

    Raises:
        InputError: the text is not XML that we trust.
    """

    def __init__(self, text: str, where: str, root: Path, folder: Path) -> None:
        self.where, self.root, self.folder = where, root.resolve(), folder
        self.top = parse(text, self.fault)

    def fault(self, message: str, remedy: str = "correct the file") -> InputError:
        """The error for something wrong in this file."""
        return InputError(f"{self.where}: {message}", remedy)

    def file(self, name: str, folder: str = "") -> str:
        """The library-relative name of a file that must exist inside the library.

        Raises:
            InputError: it does not, or the name leaves the library.
        """
        if any(not _is_local(part) for part in (name, folder or ".")):
            raise self.fault(f"file name {name!r}", "name a file relative to the folder this one lies in")
        path = (self.folder / folder / name).resolve()
        if not path.is_relative_to(self.root):
            raise self.fault(f"file name {name!r} leaves the library {self.root}", "keep files inside the library")
        if not path.is_file():
            raise self.fault(f"file {name!r} does not exist", f"put it at {path}")
        return path.relative_to(self.root).as_posix()

    def parts(self, mesh: str) -> tuple[str, ...]:
        """The meshes that ``mesh`` collides as: ``NN.part0.obj``, ``NN.part1.obj``, ... beside it, else itself."""
        stem, found = mesh.removesuffix(".obj"), list[str]()
        while len(found) < MAX_PARTS and (self.root / f"{stem}.part{len(found)}.obj").is_file():
            found.append(f"{stem}.part{len(found)}.obj")
        return tuple(found) or (mesh,)

    def numbers(self, text: str, name: str, count: int) -> tuple[float, ...]:
        """``count`` finite numbers.

        Raises:
            InputError: there are others.
        """
        found = self.some_numbers(text, name)
        if len(found) != count:
            raise self.fault(f"{name} has {len(found)} numbers", f"give {count}")
        return found

    def some_numbers(self, text: str, name: str) -> tuple[float, ...]:
        """However many finite numbers there are; errors as `numbers`."""
        try:
            found = tuple(float(word) for word in text.split())
        except ValueError:
            remedy = "give numbers; a template's placeholders must be filled first"
            raise self.fault(f"{name} is {text[:80]!r}", remedy) from None
        if not all(math.isfinite(number) and abs(number) <= MAX_METRES for number in found):
            raise self.fault(f"{name} {text[:80]!r} is not finite or beyond {MAX_METRES:g}")
        return found

    def vector(self, element: Element | None, name: str) -> Vec3:
        """Three numbers of an attribute; zeros where it is missing."""
        if element is None or name not in element.attrib:
            return (0.0, 0.0, 0.0)
        x, y, z = self.numbers(element.attrib[name], name, 3)
        return (x, y, z)

    def positive(self, numbers: tuple[float, ...], name: str) -> tuple[float, ...]:
        """The numbers, which must be lengths.

        Raises:
            InputError: one is not above 0.
        """
        if min(numbers) <= 0:
            raise self.fault(f"{name} {numbers} is not positive", "give sizes in metres above 0")
        return numbers

    def model(self, visuals: Sequence[Shape], colliders: Sequence[Shape], mass: float, friction: float) -> ObjectModel:
        """The object of these shapes.

        Raises:
            InputError: there are none or too many, or a mesh cannot be read.
        """
        if not visuals and not colliders:
            raise self.fault("neither visual nor collision", "add at least one shape")
        if max(len(visuals), len(colliders)) > MAX_SHAPES:
            raise self.fault(f"{max(len(visuals), len(colliders))} shapes, at most {MAX_SHAPES} are allowed")
        bounds = union_bounds(shape_bounds(shape, self._vertices(shape)) for shape in colliders or visuals)
        return ObjectModel(
            visuals=tuple(visuals or colliders),
            colliders=tuple(colliders),
            mass=mass,
            friction=friction,
            bounds=bounds,
        )

    def _vertices(self, shape: Shape) -> npt.NDArray[np.float64] | None:
        return None if shape.mesh is None else read_vertices(self.root / shape.mesh)


def _is_local(name: str) -> bool:
    return bool(name) and not any(letter in name for letter in ":\\\0") and not name.startswith("/")
