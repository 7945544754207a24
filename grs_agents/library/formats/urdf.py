"""Reading URDF: a rigid object of boxes, cylinders, spheres and meshes. Writing URDF: a single rigid link.

Files of users are untrusted: no document types or entities, no file outside the library root, no number that is not
finite, no size that is not positive. Links that fixed joints hold together become a single object; moving joints are
refused.
"""

import posixpath
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

from grs_agents.base import Vec3
from grs_agents.base.geometry import transforms
from grs_agents.library.formats.model_file import MAX_SHAPES, ModelFile, read_text
from grs_agents.library.shapes import (
    IDENTITY_PLACEMENT,
    ObjectModel,
    Placement,
    Rgba,
    Shape,
    quaternion_from_rpy,
    rpy_from_quaternion,
    transform_shape,
)


def format_urdf_text(
    name: str,
    visuals: Sequence[Shape],
    colliders: Sequence[Shape],
    *,
    mass: float,
    friction: float,
    inertia: Vec3 = (1e-4, 1e-4, 1e-4),
    folder: str = "",
) -> str:
    """Format the URDF of a rigid object.

    Args:
        mass: kg; 0 leaves the inertia out.
        inertia: principal moments (kg m^2) about the object frame's axes.
        folder: library-relative folder of the URDF, which its file names are written relative to.
    """
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={_quote_xml_attribute(name)}>"]
    lines += [f"  <link name={_quote_xml_attribute(name)}>", "    <contact>"]
    lines += [f'      <lateral_friction value="{friction:.6g}"/>', "    </contact>"]
    if mass > 0:
        xx, yy, zz = (f"{moment:.6g}" for moment in inertia)
        lines += ["    <inertial>", '      <origin xyz="0 0 0" rpy="0 0 0"/>', f'      <mass value="{mass:.6g}"/>']
        lines += [f'      <inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>', "    </inertial>"]
    for index, shape in enumerate(visuals):
        lines += _format_shape_element("visual", shape, folder, index)
    for index, shape in enumerate(colliders):
        lines += _format_shape_element("collision", shape, folder, index)
    return "\n".join([*lines, "  </link>", "</robot>", ""])


def _format_shape_element(tag: str, shape: Shape, folder: str, index: int) -> list[str]:
    rpy = rpy_from_quaternion(shape.quaternion)
    lines = [f"    <{tag}>", f'      <origin xyz="{format_numbers(shape.position)}" rpy="{format_numbers(rpy)}"/>']
    if shape.kind == "box":
        geometry = f'<box size="{format_numbers(shape.size)}"/>'
    elif shape.kind == "cylinder":
        geometry = f'<cylinder radius="{shape.size[0]:.6g}" length="{shape.size[1]:.6g}"/>'
    elif shape.kind == "sphere":
        geometry = f'<sphere radius="{shape.size[0]:.6g}"/>'
    else:
        file = posixpath.relpath(shape.mesh or "", folder or ".")
        geometry = f'<mesh filename={_quote_xml_attribute(file)} scale="{format_numbers(shape.size)}"/>'
    lines += [f"      <geometry>{geometry}</geometry>"]
    if tag == "visual" and (shape.color or shape.texture):
        lines += [f'      <material name="material_{index}">']
        if shape.color:
            lines += [f'        <color rgba="{format_numbers(shape.color)}"/>']
        if shape.texture:
            lines += [
                f"        <texture filename={_quote_xml_attribute(posixpath.relpath(shape.texture, folder or '.'))}/>"
            ]
        lines += ["      </material>"]
    return [*lines, f"    </{tag}>"]


def _quote_xml_attribute(text: str) -> str:
    from xml.sax.saxutils import quoteattr  # imports all of HTTP

    return quoteattr(text)


def format_numbers(numbers: Sequence[float]) -> str:
    """Numbers as URDF writes them: six significant digits, blanks between."""
    return " ".join(f"{0.0 if abs(number) < 1e-9 else number:.6g}" for number in numbers)


MAX_LINKS = 100


def iterate_links_with_placements(source: ModelFile) -> Iterator[tuple[Element, Placement]]:
    """Every link of the tree of fixed joints, with its placement in the root link's frame."""
    robot = source.top
    links = {link.get("name", ""): link for link in robot.findall("link")}
    joints, count = robot.findall("joint"), len(robot.findall("link"))
    for joint in joints:
        if joint.get("type") != "fixed":
            name, kind = joint.get("name", ""), joint.get("type", "of no type")
            raise source.make_error(f"joint {name!r} is {kind}", "make it fixed: an object is one rigid thing")
    parents = {_link_name_of_joint(joint, "child"): joint for joint in joints}
    roots = [name for name in links if name not in parents]
    one_tree = len(links) == count and len(parents) == len(joints) == count - 1 and len(roots) == 1
    if robot.tag != "robot" or not 0 < count <= MAX_LINKS or not one_tree:
        message = f"<{robot.tag}> with {count} links and {len(joints)} fixed joints"
        remedy = f"give a <robot> of one tree of 1 to {MAX_LINKS} links, each named and joined once"
        raise source.make_error(message, remedy)
    for name, link in links.items():
        placement, seen, child = IDENTITY_PLACEMENT, {name}, name
        while child in parents:
            parent_joint = parents[child]
            origin, child = parent_joint.find("origin"), _link_name_of_joint(parent_joint, "parent")
            if child in seen or child not in links:
                message = f"joint {parent_joint.get('name', '')!r} hangs on {child!r}"
                raise source.make_error(message, "join every link to another one")
            seen.add(child)
            rotation = quaternion_from_rpy(*source.read_vector_attribute(origin, "rpy"))
            placement = transforms.compose_poses((source.read_vector_attribute(origin, "xyz"), rotation), placement)
        yield link, placement


def _link_name_of_joint(joint: Element, role: str) -> str:
    element = joint.find(role)
    return "" if element is None else element.get("link", "")


_FRICTION = 0.5
_LOOK = tuple[Rgba | None, str | None]


def read_urdf(source: Path | str, root: Path, folder: str = "") -> ObjectModel:
    """Read a URDF, given as a file or as XML text.

    A mesh collides as the convex parts that lie beside it (``NAME.part0.obj`` and so on), else as its convex hull.

    Args:
        root: the library root; every file the URDF names must lie inside it.
        folder: for XML text: the folder below ``root`` that its file names are relative to.

    Raises:
        InputError: it is not a trustworthy URDF of a single rigid object; names the fault.
    """
    if isinstance(source, Path):
        return _Reader(ModelFile(read_text(source), str(source), root, source.parent)).build_object_model()
    return _Reader(ModelFile(source, "URDF text", root, root / folder)).build_object_model()


class _Reader:
    """A single pass over a URDF."""

    def __init__(self, source: ModelFile) -> None:
        self.source, self.fault = source, source.make_error
        self.looks = {look.get("name", ""): self._parse_material(look) for look in source.top.findall("material")}

    def build_object_model(self) -> ObjectModel:
        """The object the URDF describes; its frame is the first link's."""
        visuals: list[Shape] = []
        colliders: list[Shape] = []
        mass, frictions = 0.0, list[float]()
        for link, placement in iterate_links_with_placements(self.source):
            visuals += [transform_shape(shape, placement) for shape in self._read_shapes(link, "visual")]
            colliders += [transform_shape(shape, placement) for shape in self._read_shapes(link, "collision")]
            mass += self._parse_nonnegative_value(link.find("inertial/mass"), 0.0)
            friction = link.find("contact/lateral_friction")
            frictions += [] if friction is None else [self._parse_nonnegative_value(friction, _FRICTION)]
        return self.source.build_object_model(visuals, colliders, mass, frictions[0] if frictions else _FRICTION)

    def _read_shapes(self, link: Element, tag: str) -> Iterator[Shape]:
        elements = link.findall(tag)
        if len(elements) > MAX_SHAPES:
            raise self.fault(f"{len(elements)} <{tag}> elements, at most {MAX_SHAPES} are allowed")
        for element in elements:
            geometries = list(element.findall("geometry/*"))
            if len(geometries) != 1:
                raise self.fault(f"<{tag}> has {len(geometries)} shapes in <geometry>", "give exactly one")
            geometry, origin = geometries[0], element.find("origin")
            material = element.find("material") if tag == "visual" else None
            look: _LOOK = (None, None)
            if material is not None:
                named_color, named_texture = self.looks.get(material.get("name", ""), (None, None))
                color, texture = self._parse_material(material)
                look = (color or named_color, texture or named_texture)
            mesh: str | None = None
            size: tuple[float, ...]
            if geometry.tag == "box":
                kind, size = "box", self._parse_positive_sizes(geometry, "size", 3)
            elif geometry.tag == "cylinder":
                radius = self._parse_positive_sizes(geometry, "radius", 1)
                length = self._parse_positive_sizes(geometry, "length", 1)
                kind, size = "cylinder", (*radius, *length)
            elif geometry.tag == "sphere":
                kind, size = "sphere", self._parse_positive_sizes(geometry, "radius", 1)
            elif geometry.tag == "mesh":
                kind, mesh = "mesh", self.source.resolve_library_file(geometry.get("filename", ""))
                size = (
                    self._parse_positive_sizes(geometry, "scale", 3) if "scale" in geometry.attrib else (1.0, 1.0, 1.0)
                )
            else:
                raise self.fault(f"unknown shape <{geometry.tag}>", "use box, cylinder, sphere or mesh")
            position = self.source.read_vector_attribute(origin, "xyz")
            quaternion = quaternion_from_rpy(*self.source.read_vector_attribute(origin, "rpy"))
            yield Shape(
                kind=kind,
                size=size,
                position=position,
                quaternion=quaternion,
                color=look[0],
                mesh=mesh,
                texture=look[1],
            )

    def _parse_material(self, material: Element) -> _LOOK:
        color, texture = material.find("color"), material.find("texture")
        rgba: Rgba | None = None
        if color is not None:
            rgba = self.source.parse_rgba(color.get("rgba", "").replace(",", " "))
            if min(rgba) < 0 or max(rgba) > 1:
                raise self.fault(f"rgba {rgba} is outside 0..1")
        return rgba, None if texture is None else self.source.resolve_library_file(texture.get("filename", ""))

    def _parse_positive_sizes(self, element: Element, name: str, count: int) -> tuple[float, ...]:
        label = f"<{element.tag}> {name}"
        return self.source.require_positive(self.source.parse_n_numbers(element.get(name, ""), label, count), label)

    def _parse_nonnegative_value(self, element: Element | None, default: float) -> float:
        if element is None:
            return default
        (number,) = self.source.parse_n_numbers(element.get("value", ""), f"<{element.tag}> value", 1)
        if number < 0:
            raise self.fault(f"<{element.tag}> value {number} is negative", "give 0 or more")
        return number
