"""Writing URDF: the text of one rigid link that any URDF tool can load."""

import posixpath
from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from grs_agents.base import Vec3
from grs_agents.library.shapes import Shape, rpy_from_quaternion


def urdf_text(
    name: str,
    visuals: Sequence[Shape],
    colliders: Sequence[Shape],
    *,
    mass: float,
    friction: float,
    inertia: Vec3 = (1e-4, 1e-4, 1e-4),
    folder: str = "",
) -> str:
    """The URDF of one rigid object.

    Args:
        name: name of the robot and its link.
        visuals: what is seen.
        colliders: what touches.
        mass: kg; 0 leaves the inertia out.
        friction: sliding friction.
        inertia: principal moments (kg m^2) about the object frame's axes.
        folder: library-relative folder of the URDF, which its file names are written relative to.
    """
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(name)}>"]
    lines += [f"  <link name={quoteattr(name)}>", "    <contact>"]
    lines += [f'      <lateral_friction value="{friction:.6g}"/>', "    </contact>"]
    if mass > 0:
        xx, yy, zz = (f"{moment:.6g}" for moment in inertia)
        lines += [
            "    <inertial>",
            '      <origin xyz="0 0 0" rpy="0 0 0"/>',
            f'      <mass value="{mass:.6g}"/>',
        ]
        lines += [
            f'      <inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>',
            "    </inertial>",
        ]
    for index, shape in enumerate(visuals):
        lines += _element("visual", shape, folder, index)
    for index, shape in enumerate(colliders):
        lines += _element("collision", shape, folder, index)
    return "\n".join([*lines, "  </link>", "</robot>", ""])


def _element(tag: str, shape: Shape, folder: str, index: int) -> list[str]:
    rpy = rpy_from_quaternion(shape.quaternion)
    lines = [f"    <{tag}>", f'      <origin xyz="{words(shape.position)}" rpy="{words(rpy)}"/>']
    lines += [f"      <geometry>{_geometry(shape, folder)}</geometry>"]
    if tag == "visual" and (shape.color or shape.texture):
        lines += [f'      <material name="material_{index}">']
        if shape.color:
            lines += [f'        <color rgba="{words(shape.color)}"/>']
        if shape.texture:
            lines += [f"        <texture filename={quoteattr(posixpath.relpath(shape.texture, folder or '.'))}/>"]
        lines += ["      </material>"]
    return [*lines, f"    </{tag}>"]


def _geometry(shape: Shape, folder: str) -> str:
    if shape.kind == "box":
        return f'<box size="{words(shape.size)}"/>'
    if shape.kind == "cylinder":
        return f'<cylinder radius="{shape.size[0]:.6g}" length="{shape.size[1]:.6g}"/>'
    if shape.kind == "sphere":
        return f'<sphere radius="{shape.size[0]:.6g}"/>'
    file = posixpath.relpath(shape.mesh or "", folder or ".")
    return f'<mesh filename={quoteattr(file)} scale="{words(shape.size)}"/>'


def words(numbers: Sequence[float]) -> str:
    """Numbers as URDF writes them: six significant digits, blanks between."""
    return " ".join(f"{0.0 if abs(number) < 1e-9 else number:.6g}" for number in numbers)
