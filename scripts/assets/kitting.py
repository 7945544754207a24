"""The kitting shapes: flat solids that programs scale, each a visual mesh with convex colliders.

``kitting/NN.obj`` is the shape in the units that programs scale by (0.003, 0.003, 0.001): 20 high, its bottom at
z = 0, with the published origin. Beside it lie its convex parts, ``kitting/NN.part0.obj`` and so on, which the
URDF reader takes for the colliders of ``NN.obj``.
"""

from evals.synthesis.built_asset import BuiltAsset
from evals.synthesis.meshes import annulus, prism, wedges
from evals.synthesis.polygons import Floats, convex_pieces
from grs_agents.library.asset import Asset
from grs_agents.library.shapes import Rgba
from scripts.assets.outlines import Outline, outlines
from scripts.assets.templates import build_template

HEIGHT = 20.0
"""Height of a mesh in its own units: 2 cm as an object, 2 mm as the mark of a hole."""
SHOWN = 3
"""The shape of a template that names none: the square."""
_SCALE = (0.003, 0.003, 0.001)
_BLUE: Rgba = (0.16, 0.36, 0.80, 1.0)
_WEDGE_SIDES = 3


def build_kitting() -> list[BuiltAsset]:
    """The two templates; the first brings the meshes."""
    touching = _object("object-template", 0.05)
    meshes = {name: text for number, shape in enumerate(outlines()) for name, text in _meshes(number, shape).items()}
    return [BuiltAsset(touching.asset, touching.urdf, meshes), _object("object-template-nocollision", 0.0)]


def convex_outline_pieces(shape: Outline) -> list[Floats]:
    """Convex polygons that tile a shape (those of a ring have a chord for their inner side)."""
    if shape.hole is None:
        return convex_pieces(shape.corners)
    return wedges(shape.corners, shape.hole, _WEDGE_SIDES)


def _meshes(number: int, shape: Outline) -> dict[str, str]:
    stem = f"kitting/{number:02d}"
    hole, parts = shape.hole, convex_outline_pieces(shape)
    whole = prism(shape.corners, 0.0, HEIGHT) if hole is None else annulus(shape.corners, hole, 0.0, HEIGHT)
    files = {f"{stem}.obj": whole.obj()}
    if len(parts) > 1:
        files |= {f"{stem}.part{index}.obj": prism(part, 0.0, HEIGHT).obj() for index, part in enumerate(parts)}
    return files


def _object(stem: str, mass: float) -> BuiltAsset:
    extents = outlines()[SHOWN].corners
    x, y = (float(side) * 0.003 for side in extents.max(axis=0) - extents.min(axis=0))
    asset = Asset(
        name=f"kitting/{stem}.urdf",
        kind=stem,
        category="shape" if mass else "mark",
        size=(round(x, 6), round(y, 6), HEIGHT * _SCALE[2]),
        mass=mass,
        friction=0.6,
        color="blue",
        description="a flat shape out of 20 (FNAME: 00.obj to 19.obj), to be filled in"
        + ("" if mass else "; only to be seen"),
        everyday=False,
        template={"FNAME": (f"{SHOWN:02d}.obj",), "SCALE": _SCALE, "COLOR": _BLUE},
    )
    part = ("0 0 0", '<mesh filename="FNAME0" scale="SCALE0 SCALE1 SCALE2"/>')
    return build_template(asset, [part], [part] if mass else [])
