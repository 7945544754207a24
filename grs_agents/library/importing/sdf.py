"""Reading SDF, the format of Gazebo: a model of a single rigid object, converted to the equivalent URDF."""

import math
from collections.abc import Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from grs_agents.base.geometry import transforms
from grs_agents.library.colors import COLORS
from grs_agents.library.formats.model_file import Fault
from grs_agents.library.shapes import IDENTITY_PLACEMENT, Placement, quaternion_from_rpy, rpy_from_quaternion

_MOST: Final = 1e4
_NAMED_FRAMES: Final = ("", "__model__")


def convert_sdf_to_urdf(top: Element, fault: Fault, notes: list[str]) -> Element:
    """Convert an SDF file of a single model to URDF: a link with all visuals and collisions in the model's frame.

    Args:
        notes: receives the parts that URDF cannot express.

    Raises:
        InputError: by ``fault``: it is no SDF file of a single self-contained rigid model.
    """
    models = [*top.findall("model"), *top.findall("world/model")]
    if top.tag != "sdf" or len(models) != 1:
        raise fault(f"<{top.tag}> with {len(models)} models", "give an <sdf> of one <model>")
    model = models[0]
    for tag in ("include", "model", "frame"):
        if model.find(tag) is not None:
            raise fault(f"<{tag}> in <model> is not read", "write out what it stands for")
    for joint in model.findall("joint"):
        if joint.get("type") != "fixed":
            message = f"joint {joint.get('name', '')[:60]!r} is {joint.get('type', 'of no type')[:20]}"
            raise fault(message, "make it fixed: an object is one rigid thing")
    robot = Element("robot", {"name": "object"})
    link = SubElement(robot, "link", {"name": "object"})
    mass, masses = 0.0, list[str]()
    for part in model.findall("link"):
        place = _read_pose(part, fault)
        for tag in ("visual", "collision"):
            for shape in part.findall(tag):
                _add_shape(link, tag, shape, place, fault, notes)
        masses += [text for element in part.findall("inertial/mass") if (text := (element.text or "").strip())]
    for text in masses:
        (number,) = _parse_numbers(text, "mass", (1,), fault)
        mass += number
    if masses:
        SubElement(SubElement(link, "inertial"), "mass", {"value": f"{mass:.9g}"})
    friction = next((f.text for f in model.iterfind("link/collision/surface/friction/ode/mu") if f.text), None)
    if friction is not None:
        SubElement(SubElement(link, "contact"), "lateral_friction", {"value": friction.strip()})
    return robot


def _add_shape(link: Element, tag: str, shape: Element, place: Placement, fault: Fault, notes: list[str]) -> None:
    """Add a visual or collision of an SDF link that is placed by ``place`` to the URDF link."""
    geometries = [element for element in shape.findall("geometry/*") if element.tag != "empty"]
    if len(geometries) != 1:
        raise fault(f"<{tag}> has {len(geometries)} shapes in <geometry>", "give exactly one")
    geometry = geometries[0]
    (x, y, z), quaternion = transforms.compose_poses(place, _read_pose(shape, fault))
    roll, pitch, yaw = rpy_from_quaternion(quaternion)
    element = SubElement(link, tag)
    SubElement(element, "origin", {"xyz": f"{x:.9g} {y:.9g} {z:.9g}", "rpy": f"{roll:.9g} {pitch:.9g} {yaw:.9g}"})
    target = SubElement(element, "geometry")
    if geometry.tag == "mesh":
        if geometry.find("submesh") is not None:
            raise fault("<submesh> is not read", "give the part of the mesh as a file of its own")
        scale = _parse_numbers(_text(geometry, "scale") or "1 1 1", "<scale>", (3,), fault)
        words = {"filename": _text(geometry, "uri"), "scale": " ".join(f"{number:.9g}" for number in scale)}
        SubElement(target, "mesh", words)
    elif geometry.tag == "box":
        SubElement(target, "box", {"size": _text(geometry, "size")})
    elif geometry.tag in ("cylinder", "capsule"):
        SubElement(target, geometry.tag, {name: _text(geometry, name) for name in ("radius", "length")})
    elif geometry.tag == "sphere":
        SubElement(target, "sphere", {"radius": _text(geometry, "radius")})
    else:
        raise fault(f"<{geometry.tag[:40]}> is not read", "use box, cylinder, capsule, sphere or mesh")
    material = shape.find("material") if tag == "visual" else None
    if material is not None:
        # Albedo picture, diffuse colour, or the colour that a script names.
        albedo = next(filter(None, (_text(material, f"pbr/{flow}/albedo_map") for flow in ("metal", "specular"))), "")
        diffuse, script = _text(material, "diffuse"), _text(material, "script/name")
        rgb = COLORS.get(script.rpartition("/")[2].lower().replace("grey", "gray"))
        if script and not albedo and rgb is None:
            notes.append(f"the material script {script[:60]!r} is not read")
        added = SubElement(element, "material", {"name": ""})
        if rgb is not None and not diffuse:
            diffuse = " ".join(f"{share:.6g}" for share in rgb)
        if diffuse:
            SubElement(added, "color", {"rgba": diffuse})
        if albedo:
            SubElement(added, "texture", {"filename": albedo})


def _read_pose(element: Element, fault: Fault) -> Placement:
    """Position (m) and rotation of a link, visual or collision in its parent."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return IDENTITY_PLACEMENT
    frame = pose.get("relative_to", pose.get("frame", ""))
    if frame not in _NAMED_FRAMES:
        raise fault(f"<pose> is relative to {frame[:60]!r}", "give it relative to the model")
    is_quaternion = pose.get("rotation_format", "euler_rpy") == "quat_xyzw"
    numbers = _parse_numbers(pose.text or "", "<pose>", (7,) if is_quaternion else (6,), fault)
    position = (numbers[0], numbers[1], numbers[2])
    if not is_quaternion:
        unit = math.pi / 180 if pose.get("degrees", "false") in ("true", "1") else 1.0
        return position, quaternion_from_rpy(*(unit * angle for angle in numbers[3:]))
    length = float(np.linalg.norm(numbers[3:]))
    if length < 1e-9:
        raise fault("the quaternion of a <pose> is zero", "give a rotation")
    x, y, z, w = (number / length for number in numbers[3:])
    return position, (x, y, z, w)


def _text(element: Element, path: str) -> str:
    return (element.findtext(path) or "").strip()


def _parse_numbers(text: str, name: str, counts: Sequence[int], fault: Fault) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(abs(number) <= _MOST for number in numbers):
        raise fault(f"{name} is {text[:60]!r}", f"give {counts[0]} numbers of at most {_MOST:g}")
    return numbers
