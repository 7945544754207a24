"""Strict reading of a model description: every error names the file, and no path leaves the library. XML may come from
strangers: it is bounded in length and depth, without document types, entities or inclusions."""

from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_text as read_foreign_text
from grs_agents.base.geometry.hulls import extreme_points
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel, Rgba, Shape, merge_bounds, shape_bounds

MAX_BYTES, MAX_DEPTH = 1_000_000, 32

Fault = Callable[[str, str], InputError]
"""The error for a message and a remedy, telling which file they are about."""


def read_text(path: Path) -> str:
    """The text of a small UTF-8 file."""
    return read_foreign_text(path, "give a small file in UTF-8", MAX_BYTES)


def parse_xml_safely(text: str, fault: Fault) -> ElementTree.Element:
    """The root element of ``text``, which must be XML that we trust."""
    if len(text) > MAX_BYTES:
        raise fault(f"longer than {MAX_BYTES} characters", "split or simplify the file")
    check_xml_safety(text, fault, MAX_DEPTH, refused_tag="include")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise fault(f"not XML: {error}", "correct the file") from error


def check_xml_safety(text: str | bytes, fault: Fault, max_depth: int = 64, refused_tag: str | None = None) -> None:
    """Check XML of any length before a reader sees it: no document types, no entities, not too deep."""
    parser, depth = expat.ParserCreate(), 0

    def refuse_document_type(*_: object) -> None:
        raise fault("document types and entities are refused", "remove <!DOCTYPE ...>")

    def count_and_check_tag_depth(tag: str, _: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if tag.rpartition(":")[2] == refused_tag:
            raise fault(f"<{tag}> is refused", "put what it includes into the file")
        if depth > max_depth:
            raise fault(f"<{tag}> is nested deeper than {max_depth}", "simplify the file")

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse_document_type
    parser.StartElementHandler, parser.EndElementHandler = count_and_check_tag_depth, leave
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError) as error:
        raise fault(f"not XML: {error}", "correct the file") from error


MAX_SHAPES, MAX_METRES, MAX_PARTS = 500, 100.0, 64


class ModelFile:
    """The XML of a file, called ``where`` in errors; its file names are relative to ``folder``, inside ``root``."""

    def __init__(self, text: str, where: str, root: Path, folder: Path) -> None:
        self.where, self.root, self.folder = where, root.resolve(), folder
        self.top = parse_xml_safely(text, self.make_error)

    def make_error(self, message: str, remedy: str = "correct the file") -> InputError:
        """The error for something wrong in this file."""
        return InputError(f"{self.where}: {message}", remedy)

    def resolve_library_file(self, name: str, folder: str = "") -> str:
        """The library-relative name of a file, which must exist inside the library."""
        parts = (name, folder or ".")
        if any(not part or part.startswith("/") or set(part) & set(":\\\0") for part in parts):
            raise self.make_error(f"file name {name!r}", "name a file relative to the folder this one lies in")
        path = (self.folder / folder / name).resolve()
        if not path.is_relative_to(self.root):
            raise self.make_error(f"file name {name!r} leaves the library {self.root}", "keep files inside the library")
        if not path.is_file():
            raise self.make_error(f"file {name!r} does not exist", f"put it at {path}")
        return path.relative_to(self.root).as_posix()

    def parse_n_numbers(self, text: str, name: str, count: int, most: float = MAX_METRES) -> tuple[float, ...]:
        """``count`` finite numbers, none beyond ``most``."""
        numbers = self.parse_numbers(text, name, most)
        if len(numbers) != count:
            raise self.make_error(f"{name} has {len(numbers)} numbers", f"give {count}")
        return numbers

    def parse_numbers(self, text: str, name: str, most: float = MAX_METRES) -> tuple[float, ...]:
        """Any number of finite numbers; errors as `parse_n_numbers`."""
        try:
            numbers = tuple(float(word) for word in text.split())
        except ValueError:
            remedy = "give numbers; a template's placeholders must be filled first"
            raise self.make_error(f"{name} is {text[:80]!r}", remedy) from None
        if not all(abs(number) <= most for number in numbers):
            raise self.make_error(f"{name} {text[:80]!r} is not finite or beyond {most:g}")
        return numbers

    def parse_rgba(self, text: str) -> Rgba:
        """Red, green, blue, alpha; errors as `numbers`."""
        red, green, blue, alpha = self.parse_n_numbers(text, "rgba", 4)
        return (red, green, blue, alpha)

    def read_vector_attribute(self, element: Element | None, name: str) -> Vec3:
        """Three numbers of an attribute; zeros without it."""
        if element is None or name not in element.attrib:
            return (0.0, 0.0, 0.0)
        x, y, z = self.parse_n_numbers(element.attrib[name], name, 3)
        return (x, y, z)

    def require_positive(self, numbers: tuple[float, ...], name: str) -> tuple[float, ...]:
        """The numbers, which must be above 0."""
        if min(numbers) <= 0:
            raise self.make_error(f"{name} {numbers} is not positive", "give sizes in metres above 0")
        return numbers

    def build_object_model(
        self, visuals: Sequence[Shape], colliders: Sequence[Shape], mass: float, friction: float
    ) -> ObjectModel:
        """The object of these shapes; a mesh among ``colliders`` becomes the convex parts beside its file."""
        convex: list[Shape] = []
        for shape in colliders:  # ``NAME.part0.obj``, ``NAME.part1.obj``, ... beside the mesh ``NAME.obj``
            stem, parts = (shape.mesh or "").removesuffix(".obj"), list[Shape]()
            while stem and len(parts) < MAX_PARTS and (self.root / f"{stem}.part{len(parts)}.obj").is_file():
                parts.append(shape.model_copy(update={"mesh": f"{stem}.part{len(parts)}.obj"}))
            convex += parts or [shape]
        if not visuals and not convex:
            raise self.make_error("neither visual nor collision", "add at least one shape")
        if max(len(visuals), len(convex)) > MAX_SHAPES:
            raise self.make_error(f"{max(len(visuals), len(convex))} shapes, at most {MAX_SHAPES} are allowed")
        for row, shape in enumerate(convex):
            if shape.mesh is not None:
                corners = extreme_points(read_vertices(self.root / shape.mesh))
                convex[row] = shape.model_copy(update={"corners": tuple(map(to_vec3, corners))})
        bounds = merge_bounds(
            shape_bounds(shape, None if shape.mesh is None else read_vertices(self.root / shape.mesh))
            for shape in convex or visuals
        )
        seen = tuple(visuals or convex)
        return ObjectModel(visuals=seen, colliders=tuple(convex), mass=mass, friction=friction, bounds=bounds)
