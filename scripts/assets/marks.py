"""Marks on the table: zones, lines, corners, squares and rectangles, as thin boxes without colliders."""

from evals.synthesis.built_asset import BuiltAsset
from grs_agents.base import Vec3
from grs_agents.library.shapes import Rgba
from grs_agents.library.urdf_templates import STROKE_LENGTH, STROKE_WIDTH, Value
from scripts.assets.templates import Part, mark_template

_GREEN: Rgba = (0.20, 0.62, 0.25, 1.0)
_BLUE: Rgba = (0.16, 0.36, 0.80, 1.0)
_THIN, _LINE = 0.001, 0.01
_ZONE_HEIGHT = 0.002
_SIDES: tuple[Part, ...] = (
    ("0 -HALF1 0", f'<box size="DIM0 {_LINE} {_THIN}"/>'),
    ("HALF0 0 0", f'<box size="{_LINE} DIM1 {_THIN}"/>'),
    ("-HALF0 0 0", f'<box size="{_LINE} DIM1 {_THIN}"/>'),
    ("0 HALF1 0", f'<box size="DIM0 {_LINE} {_THIN}"/>'),
)
"""The sides -y, +x, -x, +y of a rectangle, in the order in which templates of fewer sides have them."""


def build_marks() -> list[BuiltAsset]:
    """Templates of all marks. Their height is fixed: programs often say 0."""
    size = (0.2, 0.2, _ZONE_HEIGHT)
    part = ("0 0 0", f'<box size="DIM0 DIM1 {_ZONE_HEIGHT}"/>')
    look = "an area of any size marked on the table (DIM0 x DIM1 m)"
    return [
        mark_template("zone/zone-template", "zone", look, size, {"DIM": size, "COLOR": _GREEN}, [part]),
        *_lines(),
        _corner(),
        *_squares(),
        *_rectangles(),
    ]


def _lines() -> list[BuiltAsset]:
    part = ("0 0 0", f'<box size="DIM0 {_LINE} {_THIN}"/>')
    look = "a green line of any length on the table (DIM0 m along x, 1 cm wide)"
    return [
        mark_template(
            f"line/{stem}", "line", look, (0.3, _LINE, _THIN), {"DIM": (0.3, _LINE, _THIN), "COLOR": _GREEN}, [part]
        )
        for stem in ("line-template", "single-green-line-template")
    ]


def _corner() -> BuiltAsset:
    """Two strokes around the +x, +y corner of a box, centred as published."""
    parts = (
        ("DIMX0 DIMY0 0", f'<box size="{STROKE_LENGTH} {STROKE_WIDTH} {_THIN}"/>'),
        ("DIMX1 DIMY1 0", f'<box size="{STROKE_WIDTH} {STROKE_LENGTH} {_THIN}"/>'),
    )
    back = (STROKE_LENGTH - STROKE_WIDTH) / 2
    size = (STROKE_LENGTH, STROKE_LENGTH, _THIN)
    template: dict[str, tuple[Value, ...]] = {"DIMX": (back, 0.0), "DIMY": (0.0, back), "COLOR": _GREEN}
    look = "a green right angle on the table: strokes around (DIMX0, DIMY0) along x and (DIMX1, DIMY1) along y"
    return mark_template("corner/corner-template", "corner", look, size, template, parts)


def _squares() -> list[BuiltAsset]:
    """Squares of side DIM0 from lines centred on HALF0: open at +y, or closed."""
    three = [(origin.replace("HALF1", "HALF0"), shape.replace("DIM1", "DIM0")) for origin, shape in _SIDES]
    kinds = (
        ("square-template", 3, _GREEN),
        ("square-template-allsides", 4, _GREEN),
        ("square-template-allsides-green", 4, _GREEN),
        ("square-template-allsides-blue", 4, _BLUE),
        ("square-template-allsides-COLOR", 4, _GREEN),
    )
    side = 0.15
    return [
        mark_template(
            f"square/{stem}",
            "square",
            f"{'an outline' if count == 4 else 'three sides'} of a square of any size on the table (DIM0 m)",
            _outlined(side, side, count),
            {"DIM": (side,), "COLOR": color},
            three[:count],
        )
        for stem, count, color in kinds
    ]


def _rectangles() -> list[BuiltAsset]:
    kinds = [(f"rectangle-template-sides-{count}", count) for count in (1, 2, 3, 4)]
    kinds += [("rectangle-template", 4), ("rectangle-template-sides-1_test", 1)]
    x, y = 0.2, 0.1
    return [
        mark_template(
            f"rectangle/{stem}",
            "rectangle",
            f"{count} of the sides of a rectangle of any size on the table (DIM0 x DIM1 m)",
            _outlined(x, y, count),
            {"DIM": (x, y), "COLOR": _GREEN},
            _SIDES[:count],
        )
        for stem, count in kinds
    ]


def _outlined(x: float, y: float, count: int) -> Vec3:
    """Extents of the first ``count`` sides."""
    width = x + _LINE if count >= 3 else x if count == 1 else x + _LINE / 2
    height = {1: _LINE, 2: y + _LINE / 2, 3: y + _LINE / 2, 4: y + _LINE}[count]
    return (round(width, 6), round(height, 6), _THIN)
