"""Blocks, balls, cylinders and the disks of Hanoi, under the names and in the sizes that published programs use."""

import math

from evals.synthesis.built_asset import BuiltAsset, build_asset, opaque
from evals.synthesis.colliders import box, cylinder, ring
from evals.synthesis.meshes import annulus
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.shapes import Shape
from scripts.assets.outlines import ROUND, regular_polygon

_BLOCKS = (
    ("block/small", 0.01, 0.001, "red", "a small red cube, 1 cm: one grain of a pile"),
    ("block/block_for_anchors", 0.04, 0.02, "red", "a light red cube, 4 cm, to hang other things on"),
    ("stacking/block", 0.04, 0.05, "red", "a red cube for stacking, 4 cm"),
    ("stacking/bigger_block", 0.06, 0.1, "red", "a red cube for stacking, 6 cm"),
    ("hanoi/block", 0.04, 0.05, "red", "a red cube, 4 cm"),
)
_BALLS = (
    ("ball/ball", 0.03, 0.05, "red", "a red ball, 6 cm"),
    ("sphere/sphere", 0.03, 0.05, "red", "a red ball, 6 cm"),
    ("sphere/sphere_rope", 0.005, 0.002, "red", "a red bead of a rope, 1 cm"),
)
_DISKS = (
    ("disk0", 0.030, 0.01, "red"),
    ("disk1", 0.035, 0.01, "orange"),
    ("disk2", 0.040, 0.01, "green"),
    ("disk3", 0.045, 0.01, "blue"),
    ("slimdisk", 0.045, 0.005, "green"),
)
_HOLE = 0.015
_CORNERS = 16


def build_toys() -> list[BuiltAsset]:
    """All loose toys."""
    blocks = [
        _solid(name, box((side, side, side)), (side, side, side), mass, color, look)
        for name, side, mass, color, look in _BLOCKS
    ]
    balls = [
        _solid(name, Shape(kind="sphere", size=(radius,)), (2 * radius, 2 * radius, 2 * radius), mass, color, look)
        for name, radius, mass, color, look in _BALLS
    ]
    stick = _solid(
        "cylinder/cylinder", cylinder(0.02, 0.06), (0.04, 0.04, 0.06), 0.05, "red", "a red cylinder, 4 x 6 cm"
    )
    return [*blocks, *balls, stick, *(_disk(*row) for row in _DISKS)]


def _solid(name: str, shape: Shape, size: Vec3, mass: float, color: str, look: str) -> BuiltAsset:
    category = {"box": "cube", "sphere": "ball"}.get(shape.kind, "cylinder")
    seen = shape.model_copy(update={"color": opaque(color)})
    return build_asset(toy_asset(name, category, size, mass, color, look), [seen], [shape])


def _disk(stem: str, radius: float, height: float, color: str) -> BuiltAsset:
    """A flat ring that drops over a peg: drawn round, touching as wedges."""
    mesh = annulus(regular_polygon(ROUND, radius, 0.0), regular_polygon(ROUND, _HOLE, 0.0), -height / 2, height / 2)
    name = f"hanoi/{stem}.obj"
    mass = round(1200 * math.pi * (radius**2 - _HOLE**2) * height, 4)
    look = f"a {color} disk with a hole, {200 * radius:g} cm wide and {100 * height:g} cm high"
    asset = toy_asset(f"hanoi/{stem}", "disk", (2 * radius, 2 * radius, height), mass, color, look)
    seen = Shape(kind="mesh", size=(1, 1, 1), mesh=name, color=opaque(color))
    touching = ring(radius, radius - _HOLE, -height / 2, height / 2, _CORNERS)
    return build_asset(asset, [seen], touching, {name: mesh.obj()})


def toy_asset(name: str, category: str, size: Vec3, mass: float, color: str, look: str, hollow: bool = False) -> Asset:
    """The manifest entry of an object that programs name and photos do not show; ``name`` without ``.urdf``."""
    return Asset(
        name=f"{name}.urdf",
        kind=name.rsplit("/", 1)[-1],
        category=category,
        size=size,
        mass=mass,
        friction=0.6,
        color=color,
        description=look,
        hollow=hollow,
        everyday=False,
    )
