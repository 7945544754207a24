"""Sandboxed worker that converts an arm from URDF to MJCF; its meshes may be of strangers."""

import json
import re
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.importing.mesh_reader import SUFFIXES, read_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportLimits, MeshPart
from grs_agents.library.mesh_files import format_obj_text
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob
from grs_agents.sim.arms.urdf_arm import SLOWEST, SPEEDS, parse_urdf

_TOOL: Final = "tool0"
"""Link of a URDF whose frame is that of the tool, z outwards, by ROS-Industrial's convention."""
_COMPILER: Final = {
    **dict.fromkeys(("discardvisual", "fusestatic", "strippath"), "false"),
    "balanceinertia": "true",
    "boundmass": "1e-4",
    "boundinertia": "1e-7",
}
"""Links without geometry and looks stay; rounded inertias are mended, and missing ones bounded (kg, kg m^2)."""


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Convert the URDF ``robot``, whose mesh names ``meshes`` maps to files below ``root``; blobs: MJCF and meshes."""
    return answer_or_refuse(lambda: _convert(Path(request["robot"]), Path(request["root"]), request["meshes"]))


def _convert(robot: Path, root: Path, files: dict[str, str]) -> dict[str, Any]:
    top = parse_urdf(robot.read_bytes())
    for element in [element for element in top if element.tag not in ("link", "joint", "material")]:
        top.remove(element)
    SubElement(SubElement(top, "mujoco"), "compiler", _COMPILER)
    folder, limits = SourceFolder(root, ImportLimits().bytes), ImportLimits()
    prefix = re.sub(r"\W+", "_", robot.stem)  # a folder may hold several arms
    assets: dict[str, bytes] = {}
    pieces: dict[str, list[tuple[str, str | None]]] = {}  # names and colours of the parts of each file
    for link in top.findall("link"):
        for shape in list(link):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            file = files[mesh.get("filename", "")]
            if file not in pieces:
                pieces[file] = list(_add_parts(folder, file, limits, prefix, assets))
            link.remove(shape)
            for name, color in pieces[file]:
                mesh.set("filename", name)
                part = deepcopy(shape)
                if color is not None and part.find("material") is None:
                    SubElement(SubElement(part, "material", name=name), "color", rgba=color)
                link.append(part)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(top, encoding="unicode"), assets=assets)
        for mesh in spec.meshes:  # meshes of looks are often open
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        _add_tool_site(spec, spec.compile())
        spec.add_text(name=SPEEDS, data=json.dumps(_read_speeds(top, robot)))
        spec.compile()
        text: str = spec.to_xml()
    except ValueError as error:
        raise InputError(
            f"robot {robot}: is no URDF that compiles: {str(error)[:300]}", "mend what it names"
        ) from error
    send_blob(f"{robot.stem}.xml", text.encode())
    for name, data in assets.items():
        send_blob(name, data)
    return {}


def _add_parts(
    folder: SourceFolder, file: str, limits: ImportLimits, prefix: str, assets: dict[str, bytes]
) -> Iterator[tuple[str, str | None]]:
    """Add a mesh to the assets, as it is or as a mesh for each of its colours; their names and colours."""
    path, stem = folder.root / file, f"{prefix}_{len(assets)}"
    suffix, data = path.suffix.lower(), path.read_bytes()
    if suffix == ".obj" or (suffix == ".stl" and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")):
        assets[f"{stem}{suffix}"] = data
        yield f"{stem}{suffix}", None
        return
    if suffix not in SUFFIXES:
        raise InputError(f"mesh {file}: is not one of {', '.join(SUFFIXES)}", "convert it")
    parts: dict[str | None, list[MeshPart]] = {}
    for part in read_mesh(folder, file, limits).parts:
        parts.setdefault(_color_of(part), []).append(part)
    for number, (color, alike) in enumerate(parts.items()):
        starts = np.cumsum([0, *(len(part.vertices) for part in alike)])
        vertices = np.vstack([part.vertices for part in alike])
        faces = np.vstack([part.faces + start for part, start in zip(alike, starts, strict=False)])
        assets[f"{stem}_{number}.obj"] = format_obj_text(vertices, faces).encode()
        yield f"{stem}_{number}.obj", color


def _color_of(part: MeshPart) -> str | None:
    """Mean colour of a part, as URDF writes it."""
    if part.colors is None:
        return None
    return " ".join(f"{value / 255:.3f}" for value in (*part.colors.mean(axis=0), 255.0))


def _read_speeds(top: Element, robot: Path) -> dict[str, float]:
    """Greatest speeds of the joints that state a positive one, rad/s or m/s. Raises InputError: it is too slow."""
    speeds: dict[str, float] = {}
    for joint in top.findall("joint"):
        limit, name = joint.find("limit"), joint.get("name", "")
        speed = float(limit.get("velocity", "0")) if limit is not None else 0.0
        if 0.0 < speed < SLOWEST:
            raise InputError(
                f"robot {robot}: joint {name!r} moves at {speed:g} rad/s or m/s at most, slower than {SLOWEST:g}",
                "correct its velocity",
            )
        if 0.0 < speed < np.inf:
            speeds[name] = speed
    return speeds


def _add_tool_site(spec: Any, model: Any) -> None:
    """Mark the tool's frame on the moving link that carries it."""
    if all(str(body.name) != _TOOL for body in spec.bodies):
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = int(model.body(_TOOL).id)
    carrier = int(model.body_weldid[tool])
    if carrier == 0:
        return
    rotation, quaternion = data.xmat[carrier].reshape(3, 3), np.empty(4)
    mujoco.mju_mat2Quat(quaternion, (rotation.T @ data.xmat[tool].reshape(3, 3)).ravel())
    spec.body(str(model.body(carrier).name)).add_site(
        name=_TOOL, pos=rotation.T @ (data.xpos[tool] - data.xpos[carrier]), quat=quaternion
    )
