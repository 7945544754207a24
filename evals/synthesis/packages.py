"""Packages as groceries come in: cans, boxes, cartons, bottles, jars, canisters and tubs, printed all around."""

import math
from dataclasses import dataclass

from evals.synthesis.built_asset import BuiltAsset
from evals.synthesis.colliders import box, stadium
from evals.synthesis.label import Label, label_texture
from evals.synthesis.meshes import Floats, loft, rectangle, superellipse
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.shapes import Shape


@dataclass(frozen=True)
class PackageForm:
    """The shape of a package, as fractions of its extents.

    Attributes:
        outline: unit cross-section.
        rings: (x, y, height) the side passes through.
        slabs: (x, y, from height, to height) of the colliders.
        faces: number of printed faces around it: four, or a front and a back.
    """

    outline: Floats
    rings: tuple[Vec3, ...]
    slabs: tuple[tuple[float, float, float, float], ...]
    faces: int


_ROUND, _SQUARISH = superellipse(2.0), superellipse(2.6)
_WHOLE = ((1.0, 1.0, 0.0, 1.0),)
_BOTTLE: tuple[Vec3, ...] = (
    (0.93, 0.93, 0.0),
    (1, 1, 0.03),
    (1, 1, 0.62),
    (0.86, 0.86, 0.70),
    (0.52, 0.52, 0.79),
    (0.52, 0.52, 0.82),
    (0.58, 0.58, 0.82),
    (0.5, 0.5, 1.0),
)
_BOTTLE_SLABS = ((1.0, 1.0, 0.0, 0.66), (0.75, 0.75, 0.66, 0.78), (0.56, 0.56, 0.78, 1.0))
FORMS: dict[str, PackageForm] = {
    "can": PackageForm(
        _ROUND,
        ((0.95, 0.95, 0.0), (1, 1, 0.03), (1, 1, 0.97), (0.97, 0.97, 1.0), (0.9, 0.9, 1.0), (0.9, 0.9, 0.97)),
        _WHOLE,
        2,
    ),
    "box": PackageForm(rectangle(), ((1, 1, 0), (1, 1, 1)), _WHOLE, 4),
    "carton": PackageForm(
        rectangle(),
        ((1, 1, 0), (1, 1, 0.76), (1, 0.08, 0.92), (1, 0.08, 1)),
        ((1, 1, 0, 0.78), (1, 0.6, 0.78, 0.85), (1, 0.32, 0.85, 1)),
        4,
    ),
    "bottle": PackageForm(_SQUARISH, _BOTTLE, _BOTTLE_SLABS, 2),
    "jar": PackageForm(
        _SQUARISH,
        (
            (0.93, 0.93, 0),
            (1, 1, 0.03),
            (1, 1, 0.66),
            (0.78, 0.78, 0.76),
            (0.78, 0.78, 0.78),
            (0.84, 0.84, 0.78),
            (0.82, 0.82, 1),
        ),
        ((1, 1, 0, 0.7), (0.84, 0.84, 0.7, 1)),
        2,
    ),
    "canister": PackageForm(
        _ROUND, ((0.96, 0.96, 0), (0.96, 0.96, 0.84), (1, 1, 0.84), (1, 1, 0.98), (0.94, 0.94, 1)), _WHOLE, 2
    ),
    "tub": PackageForm(
        _ROUND,
        ((0.78, 0.78, 0), (0.95, 0.95, 0.9), (1, 1, 0.9), (1, 1, 0.98), (0.98, 0.98, 1)),
        ((0.82, 0.82, 0, 0.5), (0.93, 0.93, 0.5, 0.88), (1, 1, 0.88, 1)),
        2,
    ),
}


@dataclass(frozen=True)
class Package:
    """A package with its print.

    Attributes:
        folder: of its library.
        kind: its name there.
        form: one of `FORMS`.
        size: extents x, y, z in m, upright.
        density: of the whole package, kg/m^3.
        color: dominant colour.
        look: a person's words for it.
        label: its print.
    """

    folder: str
    kind: str
    form: str
    size: Vec3
    density: float
    color: str
    look: str
    label: Label


def build_package(package: Package) -> BuiltAsset:
    """Mesh, texture, colliders and manifest entry of a package."""
    form, (x, y, z) = FORMS[package.form], package.size
    mesh = loft(form.outline, [(a * x / 2, b * y / 2, c * z) for a, b, c in form.rings]).centred()
    mass = round(mesh.solid().volume * package.density, 3)
    name, mesh_name, texture_name = (
        f"{package.folder}/{folder}{package.kind}{suffix}"
        for folder, suffix in (("", ".urdf"), ("meshes/", ".obj"), ("textures/", ".png"))
    )
    colliders: tuple[Shape, ...] = ()
    for a, b, low, high in form.slabs:
        bottom, top = (low - 0.5) * z, (high - 0.5) * z
        if form.faces == 4:
            colliders += (box((a * x, b * y, top - bottom), (0, 0, (bottom + top) / 2)),)
        else:
            colliders += stadium(a * x, b * y, bottom, top)
    visual = Shape(kind="mesh", size=(1, 1, 1), mesh=mesh_name, texture=texture_name, color=(1, 1, 1, 1))
    around = (y, x, y, x) if form.faces == 4 else (math.pi * (x + y) / 4,) * 2
    asset = Asset(
        name=name,
        kind=package.kind,
        category=package.form,
        size=package.size,
        mass=mass,
        friction=0.6,
        color=package.color,
        description=f"{package.look}, {100 * x:.1f} x {100 * y:.1f} x {100 * z:.1f} cm",
    )
    urdf = format_urdf_text(
        package.kind,
        [visual],
        colliders,
        mass=mass,
        friction=0.6,
        inertia=mesh.inertia(mass),
        folder=package.folder,
    )
    texture = label_texture(package.label, around, z, printed_cap=form.faces == 4)
    return BuiltAsset(asset, urdf, {mesh_name: mesh.obj()}, {texture_name: texture})
