"""Fixtures of published programs: stands, pallet, kit, insertion fixture and the ground.

Origins and dimensions are as published, since programs compute offsets from them.
"""

from evals.synthesis.built_asset import BuiltAsset, build_asset, opaque
from evals.synthesis.colliders import box, cylinder
from grs_agents.base import Vec3
from grs_agents.library.shapes import Rgba, Shape, merge_bounds, shape_bounds
from scripts.assets.toys import toy_asset

_WOOD: tuple[Rgba, ...] = ((0.86, 0.68, 0.47, 1.0), (0.64, 0.46, 0.30, 1.0), (0.40, 0.27, 0.18, 1.0))
"""Light, middle and dark wood."""
_GRAY: Rgba = (0.70, 0.69, 0.66, 1.0)
_PALLET: Vec3 = (0.30, 0.25, 0.0375)
_BOARD = 0.0075
_SUPPORT = box((0.02, 0.02, 0.001), (0, 0, -0.0195))
"""A plate under the corner of the ell's place, as published: it holds the ell up where no table is below."""


def build_fixtures() -> list[BuiltAsset]:
    """Everything that other things are put on or in."""
    red = opaque("red")
    along_x = ((0.025, -0.025, 0.1), (0.0, 0.075, 0.05), (0.05, 0.025, 0.05))
    along_y = ((-0.025, 0.025, 0.105), (0.025, 0.05, 0.055), (0.075, 0.0, 0.055))
    size = (10.0, 10.0, 0.1)
    slab = box(size, (0, 0, -size[2] / 2), color=(0.8, 0.8, 0.8, 1.0))
    asset = toy_asset("plane/plane", "ground", size, 0.0, "white", "level ground whose top is at z = 0")
    return [
        _fixture("stacking/stand", _steps(0.05, 0.005), 0.1, "brown", "three plates in a row, 5 cm wide each"),
        _fixture(
            "hanoi/stand",
            (*_steps(0.12, 0.01), *tuple(cylinder(0.005, 0.05, (0, y, 0.03), _WOOD[1]) for y in (-0.12, 0.0, 0.12))),
            0.3,
            "brown",
            "three plates in a row, a peg on each",
        ),
        _fixture("kitting/kit", (box((0.28, 0.2, 0.005), color=_WOOD[1]),), 0.2, "brown", "a flat board, 28 x 20 cm"),
        _fixture(
            "insertion/ell",
            (box((0.08, 0.03, 0.04), (0.025, 0, 0), color=red), box((0.03, 0.05, 0.04), (0, 0.04, 0), color=red)),
            0.1,
            "red",
            "a red block shaped like an L, 4 cm high",
        ),
        _fixture(
            "insertion/fixture",
            (
                *(box((length, 0.002, 0.04), (x, y, 0), color=_GRAY) for x, y, length in along_x),
                *(box((0.002, length, 0.04), (x, y, 0), color=_GRAY) for x, y, length in along_y),
            ),
            0.1,
            "gray",
            "gray walls around the place of an L-shaped block",
            (_SUPPORT,),
        ),
        _pallet(),
        build_asset(asset, [slab], [slab.model_copy(update={"color": None})]),
    ]


def _fixture(
    name: str, shapes: tuple[Shape, ...], mass: float, color: str, look: str, unseen: tuple[Shape, ...] = ()
) -> BuiltAsset:
    """Visible shapes with colliders, and ``unseen`` shapes that only collide."""
    low, high = merge_bounds(shape_bounds(shape) for shape in shapes)
    x, y, z = (round(b - a, 6) for a, b in zip(low, high, strict=True))
    size = (x, y, z)
    category = name.rsplit("/", 1)[-1]
    bare = [*(shape.model_copy(update={"color": None}) for shape in shapes), *unseen]
    return build_asset(toy_asset(name, category, size, mass, color, look, category != "ell"), shapes, bare)


def _steps(width: float, height: float) -> tuple[Shape, ...]:
    """Plates along y: light, middle, dark, the middle plate at the origin."""
    return tuple(box((width, width, height), (0, step * width, 0), color=_WOOD[step + 1]) for step in (-1, 0, 1))


def _pallet() -> BuiltAsset:
    """A deck of boards upon three beams; it touches as the solid around them, so nothing falls between."""
    x, y, z = _PALLET
    count, beam = 7, z - 2 * _BOARD
    width = x / count
    boards = [
        box((width, y, _BOARD), (width * (index - 3), 0, side * (z - _BOARD) / 2), color=_WOOD[index % 2])
        for index in range(count)
        for side in (1, -1)
        if side == 1 or index % 2 == 0
    ]
    beams = [box((x, 0.02, beam), (0, step * (y - 0.02) / 2, 0), color=_WOOD[1]) for step in (-1, 0, 1)]
    asset = toy_asset("pallet/pallet", "pallet", _PALLET, 0.4, "brown", "a small wooden pallet, 30 x 25 cm", True)
    return build_asset(asset, [*boards, *beams], [box(_PALLET)])
