"""Templates whose size and colour a program chooses; placeholders are spelt as in CLIPort."""

from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.generate.built import Built
from grs_agents.library.shapes import Rgba
from grs_agents.library.template import WALL

_COLOR = '<material name="color"><color rgba="COLOR0 COLOR1 COLOR2 COLOR3"/></material>'
_WHOLE = "DIM0 DIM1 DIM2"
_CONTAINER = (
    ("0 0 -INSET2", f"DIM0 DIM1 {WALL}"),
    ("INSET0 0 0", f"{WALL} DIM1 DIM2"),
    ("-INSET0 0 0", f"{WALL} DIM1 DIM2"),
    ("0 INSET1 0", f"DIM0 {WALL} DIM2"),
    ("0 -INSET1 0", f"DIM0 {WALL} DIM2"),
)


def build_templates() -> list[Built]:
    """Container, box, cylinder and zone."""
    boxes = [(origin, f'<box size="{size}"/>') for origin, size in _CONTAINER]
    return [
        _template(
            "container",
            "a box without a lid of any size",
            (0.20, 0.16, 0.06),
            (0.62, 0.45, 0.28, 1.0),
            "brown",
            boxes,
            mass=0.3,
        ),
        _template(
            "box",
            "a solid box of any size",
            (0.05, 0.05, 0.05),
            (0.52, 0.52, 0.52, 1.0),
            "gray",
            [("0 0 0", f'<box size="{_WHOLE}"/>')],
            mass=0.1,
        ),
        _template(
            "cylinder",
            "an upright cylinder of any size",
            (0.05, 0.05, 0.05),
            (0.52, 0.52, 0.52, 1.0),
            "gray",
            [("0 0 0", '<cylinder radius="HALF0" length="DIM2"/>')],
            mass=0.1,
        ),
        _template(
            "zone",
            "an area of any size marked on the table",
            (0.2, 0.2, 0.002),
            (0.20, 0.62, 0.25, 1.0),
            "green",
            [("0 0 0", f'<box size="{_WHOLE}"/>')],
            mass=0.0,
        ),
    ]


def _template(
    kind: str,
    look: str,
    size: Vec3,
    color: Rgba,
    color_name: str,
    shapes: list[tuple[str, str]],
    mass: float,
) -> Built:
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f'<robot name="{kind}">', f'  <link name="{kind}">']
    lines += ['    <contact><lateral_friction value="0.6"/></contact>']
    if mass > 0:
        moment = f"{mass * (size[0] ** 2 + size[1] ** 2) / 12:.6g}"
        lines += [f'    <inertial><origin xyz="0 0 0"/><mass value="{mass}"/>']
        lines += [f'      <inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial>']
    for origin, shape in shapes:
        place = f'<origin xyz="{origin}" rpy="0 0 0"/><geometry>{shape}</geometry>'
        lines += [f"    <visual>{place}", f"      {_COLOR}</visual>"]
        lines += [f"    <collision>{place}</collision>"] if mass > 0 else []
    asset = Asset(
        name=f"{kind}/{kind}-template.urdf",
        kind=f"{kind}-template",
        category=kind if kind in ("container", "zone", "box") else "cylinder",
        size=size,
        mass=mass,
        friction=0.6,
        color=color_name,
        description=f"{look} (DIM0 x DIM1 x DIM2 m), to be filled in",
        hollow=kind in ("container", "zone"),
        fixture=True,
        template={"DIM": size, "COLOR": color},
    )
    return Built(asset, "\n".join([*lines, "  </link>", "</robot>", ""]))
