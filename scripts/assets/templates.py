"""Templates whose size and colour a program chooses; placeholders are spelt as in CLIPort."""

from collections.abc import Sequence

from evals.synthesis.built_asset import BuiltAsset
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.shapes import Rgba
from grs_agents.library.urdf_templates import WALL, Value

Part = tuple[str, str]
"""Position of a shape (the text of ``<origin xyz>``) and its element."""

_COLOR = '<material name="color"><color rgba="COLOR0 COLOR1 COLOR2 COLOR3"/></material>'
_WHOLE = '<box size="DIM0 DIM1 DIM2"/>'
_ROUND = '<sphere radius="HALF0"/>'
_CONTAINER = (
    ("0 0 -INSET2", f"DIM0 DIM1 {WALL}"),
    ("INSET0 0 0", f"{WALL} DIM1 DIM2"),
    ("-INSET0 0 0", f"{WALL} DIM1 DIM2"),
    ("0 INSET1 0", f"DIM0 {WALL} DIM2"),
    ("0 -INSET1 0", f"DIM0 {WALL} DIM2"),
)
_BROWN: Rgba = (0.62, 0.45, 0.28, 1.0)
_GRAY: Rgba = (0.52, 0.52, 0.52, 1.0)
_RED: Rgba = (0.85, 0.16, 0.16, 1.0)


def build_templates() -> list[BuiltAsset]:
    """Container, box, block, cylinder and balls."""
    walls = [(origin, f'<box size="{size}"/>') for origin, size in _CONTAINER]
    stick = '<cylinder radius="HALF0" length="DIM2"/>'
    return [
        _solid("container/container", "a box without a lid of any size", (0.20, 0.16, 0.06), _BROWN, walls, 0.3),
        _solid("box/box", "a solid box of any size", (0.05, 0.05, 0.05), _GRAY, [("0 0 0", _WHOLE)], 0.1),
        _solid("block/block", "a solid block of any size", (0.04, 0.04, 0.04), _GRAY, [("0 0 0", _WHOLE)], 0.05),
        _solid(
            "cylinder/cylinder", "an upright cylinder of any size", (0.05, 0.05, 0.05), _GRAY, [("0 0 0", stick)], 0.1
        ),
        _solid("ball/ball", "a ball of any size", (0.04, 0.04, 0.04), _RED, [("0 0 0", _ROUND)], 0.05),
        _solid("sphere/sphere", "a ball of any size", (0.04, 0.04, 0.04), _RED, [("0 0 0", _ROUND)], 0.05),
    ]


def _solid(name: str, look: str, size: Vec3, color: Rgba, parts: Sequence[Part], mass: float) -> BuiltAsset:
    category = name.rsplit("/", 1)[-1].replace("sphere", "ball")
    asset = Asset(
        name=f"{name}-template.urdf",
        kind=f"{name.rsplit('/', 1)[-1]}-template",
        category=category,
        size=size,
        mass=mass,
        friction=0.6,
        color=color_name_from_rgb(color[:3]),
        description=f"{look} (DIM0 x DIM1 x DIM2 m), to be filled in",
        hollow=category == "container",
        fixture=category not in ("ball", "block"),
        everyday=category not in ("ball", "block"),
        template={"DIM": size, "COLOR": color},
    )
    return build_template(asset, parts, parts)


def build_template(asset: Asset, visuals: Sequence[Part], colliders: Sequence[Part]) -> BuiltAsset:
    """The URDF of a template of these shapes, in the single colour ``COLOR``."""
    stem, size, mass = asset.name.split("/", 1)[0], asset.size, asset.mass
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f'<robot name="{stem}">', f'  <link name="{stem}">']
    lines += [f'    <contact><lateral_friction value="{asset.friction:g}"/></contact>']
    if mass > 0:
        moment = f"{mass * (size[0] ** 2 + size[1] ** 2) / 12:.6g}"
        lines += [f'    <inertial><origin xyz="0 0 0"/><mass value="{mass}"/>']
        lines += [f'      <inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial>']
    for origin, shape in visuals:
        lines += [f"    <visual>{_place(origin, shape)}", f"      {_COLOR}</visual>"]
    for origin, shape in colliders:
        lines += [f"    <collision>{_place(origin, shape)}</collision>"]
    return BuiltAsset(asset, "\n".join([*lines, "  </link>", "</robot>", ""]))


def mark_template(
    name: str, category: str, look: str, size: Vec3, template: dict[str, tuple[Value, ...]], parts: Sequence[Part]
) -> BuiltAsset:
    """A template of something drawn on the table, which nothing collides with; ``name`` without ``.urdf``."""
    color = tuple(float(value) for value in template["COLOR"])
    asset = Asset(
        name=f"{name}.urdf",
        kind=name.rsplit("/", 1)[-1],
        category=category,
        size=size,
        mass=0.0,
        friction=0.6,
        color=color_name_from_rgb((color[0], color[1], color[2])),
        description=f"{look}, to be filled in",
        hollow=category == "zone",
        fixture=category == "zone",
        everyday=category == "zone",
        template=template,
    )
    return build_template(asset, parts, ())


def _place(origin: str, shape: str) -> str:
    return f'<origin xyz="{origin}" rpy="0 0 0"/><geometry>{shape}</geometry>'
