"""Reading MJCF: the one object of a MuJoCo file, of boxes, cylinders, capsules, spheres and meshes.

The same care as for URDF: nothing is run or included, no file outside the library root is opened, what we do not
understand is refused by name. A body with its children, which must not move against it, is one object; a free joint
on it may stand there. Default classes count for geoms and meshes. A capsule becomes the cylinder of its length. Geoms
that collide with nothing (contype = conaffinity = 0) are looks; where a file has none, the colliders are seen.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from grs_agents.library.formats.mjcf_frame import Frames
from grs_agents.library.formats.mjcf_look import Defaults, looks
from grs_agents.library.formats.model_file import Source
from grs_agents.library.formats.safe_xml import read_text
from grs_agents.library.shapes import HERE, ObjectModel, Placement, Rgba, Shape, ShapeKind, composed

_REFUSED = ("include", "plugin", "extension", "attach", "model", "replicate", "composite", "flexcomp", "frame")
_FRICTION, _DENSITY = 1.0, 1000.0


@dataclass(frozen=True)
class _Geom:
    shape: Shape
    collides: bool
    mass: float | None
    friction: float


def read_mjcf(path: Path, root: Path) -> ObjectModel:
    """What an MJCF file says of its one object; the frame is that of its outermost body.

    Args:
        path: the file.
        root: the library root; every file it names must lie inside.

    Raises:
        InputError: the file is not MJCF of one rigid object that we can trust; names the fault.
    """
    return _Reader(Source(read_text(path), str(path), root, path.parent)).model()


class _Reader:
    """One pass over one file."""

    def __init__(self, source: Source) -> None:
        self.source = source
        if source.top.tag != "mujoco":
            raise source.fault(f"<{source.top.tag}> is not MJCF", "give a <mujoco> file")
        for element in source.top.iter():
            if element.tag in _REFUSED:
                raise source.fault(f"<{element.tag}> is refused", "write out what it stands for")
        self.defaults = Defaults(source.top)
        compiler = {name: value for one in source.top.findall("compiler") for name, value in one.attrib.items()}
        self.frames = Frames(source, compiler)
        self.folder = compiler.get("meshdir", compiler.get("assetdir", ""))
        self.materials = looks(source)
        self.meshes = {self._mesh_name(one): one for one in source.top.findall("asset/mesh")}

    def model(self) -> ObjectModel:
        """The object."""
        bodies, loose = self.source.top.findall("worldbody/body"), self.source.top.findall("worldbody/geom")
        if len(bodies) != 1 or loose:
            found = f"{len(bodies)} bodies and {len(loose)} loose geoms in <worldbody>"
            raise self.source.fault(found, "give exactly one <body> that holds every geom")
        weights: list[float] = []
        geoms = list(self._body(bodies[0], HERE, "", weights, True))
        colliders = [geom for geom in geoms if geom.collides]
        mass = sum(weights) if weights else sum(self._mass(geom) for geom in geoms)
        visuals = [geom.shape for geom in geoms if not geom.collides]
        touching = [geom.shape.model_copy(update={"mesh": name}) for geom in colliders for name in self._parts(geom)]
        seen = visuals or [geom.shape for geom in colliders]
        return self.source.model(seen, touching, mass, colliders[0].friction if colliders else _FRICTION)

    def _body(
        self, body: Element, place: Placement, inherited: str, weights: list[float], top: bool
    ) -> Iterator[_Geom]:
        name, kind = body.get("name", ""), body.get("childclass", inherited)
        for joint in body.findall("joint"):
            if not (top and joint.get("type") == "free"):
                named = f"joint {joint.get('name', '')!r} of body {name!r} is a {joint.get('type', 'hinge')}"
                raise self.source.fault(named, "remove it: an object is one rigid thing")
        if body.findall("freejoint") and not top:
            raise self.source.fault(f"body {name!r} is free inside another one", "keep one object in one file")
        for inertial in body.findall("inertial"):
            weights.append(self._one(inertial.get("mass", ""), "<inertial> mass"))
        for geom in body.findall("geom"):
            yield self._geom(self.defaults.of(geom, kind), place)
        for child in body.findall("body"):
            yield from self._body(child, composed(place, self.frames.placement(child.attrib)), kind, weights, False)

    def _geom(self, said: dict[str, str], place: Placement) -> _Geom:
        name, kind = said.get("name", ""), said.get("type", "sphere")
        mesh, size, local = None, (), self.frames.placement(said)
        if kind == "mesh":
            mesh, size = self._mesh(said.get("mesh", ""))
        elif kind in ("box", "sphere", "cylinder", "capsule"):
            size, local = self._sizes(kind, said, local)
        else:
            raise self.source.fault(f"geom {name!r} is a {kind}", "use box, sphere, cylinder, capsule or mesh")
        kinds: dict[str, ShapeKind] = {"box": "box", "sphere": "sphere", "mesh": "mesh"}
        position, quaternion = composed(place, local)
        friction = self.source.some_numbers(said.get("friction", f"{_FRICTION}"), "friction")
        shape = Shape(
            kind=kinds.get(kind, "cylinder"),
            size=size,
            position=position,
            quaternion=quaternion,
            color=self._color(said),
            mesh=mesh,
        )
        collides = any(self._one(said.get(bit, "1"), bit) for bit in ("contype", "conaffinity"))
        mass = self._one(said["mass"], "mass") if "mass" in said else self._weight(shape, said)
        return _Geom(shape, collides, mass, friction[0] if friction else _FRICTION)

    def _sizes(self, kind: str, said: dict[str, str], local: Placement) -> tuple[tuple[float, ...], Placement]:
        """Extents of a primitive as `Shape` gives them; MJCF's sizes are halves."""
        words = self.source.some_numbers(said.get("size", ""), f"<geom> size of a {kind}")
        length: float | None = None
        if "fromto" in said and kind != "sphere":
            length, local = self.frames.between(said["fromto"])
        needed = 3 if kind == "box" else 1 if kind == "sphere" or length is not None else 2
        if len(words) < needed or (kind == "box" and length is not None):
            raise self.source.fault(
                f"<geom> size {words} of a {kind}", f"give {needed} numbers, and no fromto for a box"
            )
        if kind == "box":
            size = tuple(2 * half for half in words[:3])
        elif kind == "sphere":
            size = words[:1]
        else:
            length = 2 * words[1] if length is None else length
            size = (words[0], length + (2 * words[0] if kind == "capsule" else 0.0))
        return self.source.positive(size, f"<geom> size of a {kind}"), local

    def _mesh(self, name: str) -> tuple[str, tuple[float, ...]]:
        if name not in self.meshes:
            raise self.source.fault(f"mesh {name!r} is not among the assets", "name a <mesh> of <asset>")
        said = self.defaults.of(self.meshes[name], "")
        for refused in ("vertex", "refpos", "refquat", "builtin"):
            if refused in said:
                raise self.source.fault(f"mesh {name!r} has {refused}", "give it as a file in its own frame")
        scale = self.source.numbers(said.get("scale", "1 1 1"), "<mesh> scale", 3)
        return self.source.file(said.get("file", ""), self.folder), self.source.positive(scale, "<mesh> scale")

    def _mesh_name(self, mesh: Element) -> str:
        return mesh.get("name") or Path(mesh.get("file", "")).stem

    def _parts(self, geom: _Geom) -> tuple[str | None, ...]:
        return self.source.parts(geom.shape.mesh) if geom.shape.mesh else (None,)

    def _color(self, said: dict[str, str]) -> Rgba | None:
        if "rgba" not in said:
            return self.materials.get(said.get("material", ""))
        red, green, blue, alpha = self.source.numbers(said["rgba"], "rgba", 4)
        return (red, green, blue, alpha)

    def _weight(self, shape: Shape, said: dict[str, str]) -> float | None:
        """Mass by density, kg; None for a mesh, whose volume we do not measure."""
        density = self._one(said.get("density", f"{_DENSITY}"), "density", 1e5)
        if density == 0:
            return 0.0
        if shape.kind == "mesh":
            return None
        volumes = {"box": math.prod(shape.size), "sphere": 4 / 3 * math.pi * shape.size[0] ** 3}
        return density * volumes.get(shape.kind, math.pi * shape.size[0] ** 2 * shape.size[-1])

    def _mass(self, geom: _Geom) -> float:
        if geom.mass is not None:
            return geom.mass
        if not geom.collides:
            return 0.0
        raise self.source.fault(
            f"mesh geom {geom.shape.mesh!r} has no mass", "give the geom a mass or the body an <inertial>"
        )

    def _one(self, text: str, name: str, most: float = 1e3) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0 <= number <= most:
            raise self.source.fault(f"{name} is {text[:40]!r}", f"give a number from 0 to {most:g}")
        return number
