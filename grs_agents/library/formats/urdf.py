"""Reading URDF: one rigid object of boxes, cylinders, spheres and meshes.

The files may come from users, so the reader trusts nothing: no document types or entities, no file outside
the library root, no number that is not finite, no size that is not positive. Links that fixed joints hold together
become one object; what moves in itself is refused.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

from grs_agents.library.formats.model_file import MAX_SHAPES, Source
from grs_agents.library.formats.safe_xml import read_text
from grs_agents.library.formats.urdf_tree import link_placements
from grs_agents.library.shapes import ObjectModel, Rgba, Shape, moved, quaternion_from_rpy

_DEFAULT_FRICTION = 0.5
_LOOK = tuple[Rgba | None, str | None]


def read_urdf(source: Path | str, root: Path, folder: str = "") -> ObjectModel:
    """What a URDF says.

    A mesh that collides does so as the convex parts that lie beside it (``NAME.part0.obj`` and so on), else as
    its convex hull.

    Args:
        source: the file (a ``Path``) or the XML text (a ``str``).
        root: the library root; every file the URDF names must lie inside it.
        folder: for XML text: the folder below ``root`` that its file names are relative to.

    Raises:
        InputError: the file or text is not a URDF of one rigid object that we can trust; names the fault.
    """
    if isinstance(source, Path):
        return _Reader(Source(read_text(source), str(source), root, source.parent)).model()
    return _Reader(Source(source, "URDF text", root, root / folder)).model()


class _Reader:
    """One pass over one URDF."""

    def __init__(self, source: Source) -> None:
        self.source, self.fault = source, source.fault
        self.looks = {one.get("name", ""): self._own_look(one) for one in source.top.findall("material")}

    def model(self) -> ObjectModel:
        """The object the URDF describes; its frame is the first link's."""
        visuals: list[Shape] = []
        colliders: list[Shape] = []
        mass, frictions = 0.0, list[float]()
        for link, placement in link_placements(self.source):
            visuals += [moved(shape, placement) for shape in self._shapes(link, "visual")]
            colliders += [moved(shape, placement) for shape in self._shapes(link, "collision")]
            mass += self._scalar(link.find("inertial/mass"), 0.0)
            friction = link.find("contact/lateral_friction")
            frictions += [] if friction is None else [self._scalar(friction, _DEFAULT_FRICTION)]
        return self.source.model(visuals, colliders, mass, frictions[0] if frictions else _DEFAULT_FRICTION)

    def _shapes(self, link: Element, tag: str) -> Iterator[Shape]:
        elements = link.findall(tag)
        if len(elements) > MAX_SHAPES:
            raise self.fault(f"{len(elements)} <{tag}> elements, at most {MAX_SHAPES} are allowed")
        for element in elements:
            shape = self._shape(element, tag)
            names = self.source.parts(shape.mesh) if tag == "collision" and shape.mesh else (shape.mesh,)
            yield from (shape.model_copy(update={"mesh": name}) for name in names)

    def _shape(self, element: Element, tag: str) -> Shape:
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
            radius, length = self._sizes(geometry, "radius", 1), self._sizes(geometry, "length", 1)
            kind, size = "cylinder", (*radius, *length)
        elif geometry.tag == "sphere":
            kind, size = "sphere", self._sizes(geometry, "radius", 1)
        elif geometry.tag == "mesh":
            kind, mesh = "mesh", self.source.file(geometry.get("filename", ""))
            size = self._sizes(geometry, "scale", 3) if "scale" in geometry.attrib else (1.0, 1.0, 1.0)
        else:
            raise self.fault(f"unknown shape <{geometry.tag}>", "use box, cylinder, sphere or mesh")
        return Shape(
            kind=kind,
            size=size,
            position=self.source.vector(origin, "xyz"),
            quaternion=quaternion_from_rpy(*self.source.vector(origin, "rpy")),
            color=color,
            mesh=mesh,
            texture=texture,
        )

    def _look(self, material: Element | None) -> _LOOK:
        if material is None:
            return None, None
        color, texture = self._own_look(material)
        named_color, named_texture = self.looks.get(material.get("name", ""), (None, None))
        return color or named_color, texture or named_texture

    def _own_look(self, material: Element) -> _LOOK:
        color, texture = material.find("color"), material.find("texture")
        rgba: Rgba | None = None
        if color is not None:
            numbers = self.source.numbers(color.get("rgba", "").replace(",", " "), "rgba", 4)
            if min(numbers) < 0 or max(numbers) > 1:
                raise self.fault(f"rgba {numbers} is outside 0..1")
            rgba = (numbers[0], numbers[1], numbers[2], numbers[3])
        return rgba, None if texture is None else self.source.file(texture.get("filename", ""))

    def _sizes(self, element: Element, name: str, count: int) -> tuple[float, ...]:
        label = f"<{element.tag}> {name}"
        return self.source.positive(self.source.numbers(element.get(name, ""), label, count), label)

    def _scalar(self, element: Element | None, default: float) -> float:
        if element is None:
            return default
        (number,) = self.source.numbers(element.get("value", ""), f"<{element.tag}> value", 1)
        if number < 0:
            raise self.fault(f"<{element.tag}> value {number} is negative", "give 0 or more")
        return number
