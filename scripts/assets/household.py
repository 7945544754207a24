"""Cubes, containers, bowls, mugs, plates, zones and the templates that programs fill in."""

from collections.abc import Sequence

from evals.synthesis.built_asset import BuiltAsset, build_asset, opaque
from evals.synthesis.colliders import box, cylinder, lifted, open_box, ring
from evals.synthesis.meshes import Mesh, loft, superellipse
from evals.synthesis.products import mug_parts
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.shapes import Rgba, Shape, merge_bounds, shape_bounds

_CUBE = 0.04
_CUBE_COLORS = ("red", "green", "blue", "yellow", "orange", "purple", "cyan", "brown", "gray", "white")
_ROUND = superellipse(2.0, 32)


def build_household() -> list[BuiltAsset]:
    """Everything that is neither a grocery nor a template."""
    return [*build_cubes(), *build_open_boxes(), build_bowl(), build_mug(), build_plate(), build_zone()]


def build_cubes() -> list[BuiltAsset]:
    """A 4 cm cube for each colour, and the neutral ``block/block.urdf``."""
    cubes = [(f"{name}_block", name) for name in _CUBE_COLORS]
    return [_cube(stem, color) for stem, color in [("block", "gray"), *cubes]]


def _cube(stem: str, color: str) -> BuiltAsset:
    size = (_CUBE, _CUBE, _CUBE)
    solid = box(size, color=opaque(color))
    look = f"a {color} cube, 4 cm" if stem != "block" else "a plain gray cube, 4 cm, to be given any colour"
    asset = _asset(f"block/{stem}.urdf", stem, "cube", size, 0.05, color, look)
    return build_asset(asset, [solid], [solid])


def build_open_boxes() -> list[BuiltAsset]:
    """Boxes without a lid, in two sizes."""
    kinds = (
        (
            "open_box",
            (0.30, 0.22, 0.09),
            "brown",
            0.35,
            "a large brown cardboard box without a lid, 30 x 22 x 9 cm",
        ),
        (
            "small_open_box",
            (0.18, 0.14, 0.06),
            "blue",
            0.15,
            "a small blue plastic box without a lid, 18 x 14 x 6 cm",
        ),
    )
    built: list[BuiltAsset] = []
    for stem, size, color, mass, look in kinds:
        tint: Rgba = (0.72, 0.54, 0.36, 1.0) if color == "brown" else opaque(color)
        walls = open_box(size, 0.005, tint)
        asset = _asset(f"container/{stem}.urdf", stem, "container", size, mass, color, look, True, True)
        built.append(build_asset(asset, walls, walls))
    return built


def build_bowl() -> BuiltAsset:
    """A round bowl, 16 cm wide and 6 cm high."""
    outer = ((0.035, 0.0), (0.052, 0.006), (0.068, 0.022), (0.076, 0.042), (0.080, 0.060))
    inner = ((0.076, 0.060), (0.072, 0.043), (0.064, 0.025), (0.048, 0.010), (0.030, 0.006))
    mesh = loft(_ROUND, [(r, r, z) for r, z in (*outer, *inner)]).centred()
    colliders = (
        cylinder(0.056, 0.008, (0, 0, 0.004)),
        *ring(0.068, 0.008, 0.006, 0.024),
        *ring(0.075, 0.006, 0.024, 0.042),
        *ring(0.080, 0.005, 0.042, 0.060),
    )
    size = (0.16, 0.16, 0.06)
    look = "a white bowl, 16 cm wide and 6 cm high"
    asset = _asset("bowl/bowl.urdf", "bowl", "bowl", size, 0.25, "white", look, True, True)
    return _with_mesh(asset, [("bowl/bowl.obj", mesh, (0.93, 0.92, 0.88, 1.0))], colliders)


def build_mug() -> BuiltAsset:
    """A mug 8 cm wide and 9.5 cm high; its handle points to +x."""
    parts = mug_parts(0.040, 0.095, 0.030)
    look = "a red mug with a handle, 8 cm wide and 9.5 cm high"
    asset = _asset("mug/mug.urdf", "mug", "mug", parts.size, 0.30, "red", look, True)
    color: Rgba = (0.78, 0.18, 0.17, 1.0)
    meshes = [("mug/mug.obj", parts.body, color), ("mug/handle.obj", parts.handle, color)]
    return _with_mesh(asset, meshes, parts.colliders)


def build_plate() -> BuiltAsset:
    """A flat plate, 22 cm wide."""
    profile = ((0.065, 0.0), (0.070, 0.004), (0.110, 0.016), (0.110, 0.018), (0.107, 0.018), (0.068, 0.007))
    mesh = loft(_ROUND, [(r, r, z) for r, z in profile]).centred()
    colliders = (
        cylinder(0.070, 0.007, (0, 0, 0.0035)),
        *ring(0.092, 0.026, 0.005, 0.012, 16),
        *ring(0.110, 0.022, 0.011, 0.018, 16),
    )
    look = "a white plate, 22 cm wide"
    asset = _asset("plate/plate.urdf", "plate", "plate", (0.22, 0.22, 0.018), 0.35, "white", look, True, True)
    return _with_mesh(asset, [("plate/plate.obj", mesh, (0.90, 0.92, 0.95, 1.0))], lifted(colliders, (0, 0, -0.009)))


def build_zone() -> BuiltAsset:
    """A coloured area on the table that nothing collides with."""
    size = (0.12, 0.12, 0.002)
    look = "a green square marked on the table, 12 x 12 cm, to place things on"
    asset = _asset("zone/zone.urdf", "zone", "zone", size, 0.0, "green", look, True, True)
    return build_asset(asset, [box(size, color=opaque("green"))], [])


def _asset(
    name: str,
    kind: str,
    category: str,
    size: Vec3,
    mass: float,
    color: str,
    description: str,
    hollow: bool = False,
    fixture: bool = False,
) -> Asset:
    return Asset(
        name=name,
        kind=kind,
        category=category,
        size=size,
        mass=mass,
        friction=0.6,
        color=color,
        description=description,
        hollow=hollow,
        fixture=fixture,
    )


def _with_mesh(asset: Asset, meshes: Sequence[tuple[str, Mesh, Rgba]], colliders: tuple[Shape, ...]) -> BuiltAsset:
    """An asset whose looks are plain coloured meshes; colliders that start at z = 0 are centred."""
    low, high = merge_bounds(shape_bounds(shape) for shape in colliders)
    centred = lifted(colliders, (0, 0, -(low[2] + high[2]) / 2))
    visuals = [Shape(kind="mesh", size=(1, 1, 1), mesh=name, color=color) for name, _, color in meshes]
    return build_asset(asset, visuals, centred, {name: mesh.obj() for name, mesh, _ in meshes})
