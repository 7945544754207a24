"""URDF templates: placeholders ``DIM0``, ``HALF1``, ``COLOR3``, ``FNAME0`` become values, as in CLIPort.

A template documents its placeholders, and their meaning, in the defaults of its manifest entry. Programs state the same
size in several ways: a template with ``DIM`` (the extents x, y, z in m, for round objects too) also accepts these
stems, in this order, for components that ``DIM`` itself leaves open:

=====================  =====================================================
``HALF``               half of the extents
``DIMX DIMY DIMZ``     one extent each
``DIMR``, ``DIMH``     radius, and height
``SCALE``              extents, as of a unit solid
=====================  =====================================================

A corner, which has ``DIMX`` and ``DIMY`` (the two strokes' centres), also accepts ``DIM``: the size of the box, centred
on the corner's origin, whose corner it marks. A bare number applies to every component; ``COLOR`` may be a colour's
name; of ``FNAME`` the last part alone counts, a file beside the template.
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import PurePosixPath
from typing import cast

import numpy as np

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.colors import COLORS

Value = float | str
Values = Mapping[str, Sequence[Value] | float | str]
Row = list[Value]
Defaults = Mapping[str, Sequence[Value]]
Given = Mapping[str, Mapping[int, Value]]
Filled = dict[str, tuple[Value, ...]]

WALL = 0.005
"""Thickness in m of the walls and floors of templates."""
STROKE_LENGTH, STROKE_WIDTH = 0.055, 0.005
"""Length and width in m of the two strokes of a corner."""

_PLACEHOLDER = re.compile(r"\b(DIM[A-Z]?|HALF|INSET|COLOR|SCALE|FNAME)(\d?)\b")
_FILE_NAME = re.compile(r"[\w-][\w.-]*")
_LENGTH_STEMS: dict[str, tuple[tuple[int, int, float], ...]] = {
    "HALF": ((0, 0, 2.0), (1, 1, 2.0), (2, 2, 2.0)),
    "DIMX": ((0, 0, 1.0),),
    "DIMY": ((0, 1, 1.0),),
    "DIMZ": ((0, 2, 1.0),),
    "DIMR": ((0, 0, 2.0), (0, 1, 2.0)),
    "DIMH": ((0, 2, 1.0),),
    "SCALE": ((0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)),
}
"""Other ways to say ``DIM``: (index there, index in ``DIM``, factor)."""


def known_placeholder_stems(defaults: Mapping[str, Sequence[Value]]) -> frozenset[str]:
    """Every stem that a template with these defaults understands."""
    known = set(defaults)
    if "DIM" in defaults:
        known |= {*_LENGTH_STEMS, "INSET"}
    if "DIMX" in defaults and "DIMY" in defaults:
        known.add("DIM")
    return frozenset(known)


def resolve_template_values(replace: Values, defaults: Defaults) -> tuple[Filled, Filled]:
    """Values of a template's own placeholders, and the defaults that ``replace`` leaves as they are. If ``replace``
    gives some components of a stem, the others count as defaults; an alpha alone does not. Raises InputError: a value
    is not a finite number, a colour or a file name."""
    known = known_placeholder_stems(defaults)
    given: dict[str, dict[int, Value]] = {
        stem: dict(enumerate(_parse_placeholder_value(stem, value, len(defaults.get(stem, (0, 0, 0))))))
        for stem, value in replace.items()
    }
    stated = _convert_to_placeholders_of_template(given, defaults, known)
    values: Filled = {}
    assumed: Filled = {}
    for stem, default in defaults.items():
        row = stated.get(stem, {})
        count = max([len(default), *(index + 1 for index in row)])
        values[stem] = tuple(row.get(index, default[min(index, len(default) - 1)]) for index in range(count))
        left = tuple(default[index] for index in range(len(default)) if index not in row)
        if left and not (stem == "COLOR" and len(row) >= 3):
            assumed[stem] = left
    return values | _explicit_half_extents(given, values, known), assumed


def _convert_to_placeholders_of_template(given: Given, defaults: Defaults, known: Collection[str]) -> Given:
    """The given values by the stems of the template: lengths in ``DIM``, the centres of a corner's strokes."""
    stated = {stem: given.get(stem, {}) for stem in defaults}
    if "DIM" in defaults:
        stems = [stem for stem in _LENGTH_STEMS if stem in known and stem not in defaults]
        lengths: dict[int, Value] = dict(given.get("DIM", {}))
        for stem in stems:
            for source, target, factor in _LENGTH_STEMS[stem]:
                if target not in lengths and source in given.get(stem, {}):
                    lengths[target] = factor * float(given[stem][source])
        return stated | {"DIM": lengths}
    if "DIM" in known and len(given.get("DIM", {})) >= 2:
        size = given["DIM"]
        x, y = (float(size[axis]) / 2 + STROKE_WIDTH / 2 for axis in (0, 1))
        back = (STROKE_LENGTH - STROKE_WIDTH) / 2
        return {"DIMX": {0: x - back, 1: x}, "DIMY": {0: y, 1: y - back}} | {
            stem: row for stem, row in stated.items() if row
        }
    return stated


def fill_template(text: str, replace: Values, defaults: Mapping[str, Sequence[Value]] | None = None) -> str:
    """The URDF text of a template with its placeholders replaced.

    ``{"DIM": (x, y, z)}`` puts x for ``DIM0``, y for ``DIM1``, z for ``DIM2``; a placeholder without a number is the
    first. Missing values come from ``defaults``, if given; ``HALF`` (half of ``DIM``) and ``INSET`` (``HALF`` less half
    a wall) follow from ``DIM`` unless they are given.

    Raises:
        InputError: a value is not a finite number, a colour or a file name, or a placeholder has no value.
    """
    if defaults is None:
        values = {stem: tuple(_parse_placeholder_value(stem, value, 1)) for stem, value in replace.items()}
    else:
        values, _ = resolve_template_values(replace, defaults)
    lengths = [float(value) for value in values.get("DIM", ())]
    insets = tuple(max(0.0, length - WALL) / 2 for length in lengths)
    derived: Filled = {"HALF": tuple(length / 2 for length in lengths), "INSET": insets}
    merged = derived | values
    left: set[str] = set()

    def word(match: re.Match[str]) -> str:
        row, index = merged.get(match.group(1), ()), int(match.group(2) or 0)
        if index >= len(row):
            left.add(match.group(0))
            return match.group(0)
        value = row[index]
        return value if isinstance(value, str) else f"{value:.6g}"

    filled = _PLACEHOLDER.sub(word, text)
    if left:
        raise InputError(f"template placeholder {min(left)} has no value", f"give {', '.join(sorted(left))}")
    return filled


def _explicit_half_extents(given: Given, values: Defaults, known: Collection[str]) -> Filled:
    """A ``HALF`` of its own: three-sided squares set their lines back by half a line."""
    if "HALF" not in known or "HALF" in values or not {"HALF", "DIM"} <= set(given):
        return {}
    halves = [float(value) / 2 for value in values["DIM"]]
    explicit = [float(given["HALF"].get(index, half)) for index, half in enumerate(halves)]
    return {} if np.allclose(explicit, halves, atol=1e-7) else {"HALF": tuple(explicit)}


def _parse_placeholder_value(stem: str, value: Sequence[Value] | float | str, count: int) -> Row:
    bare = isinstance(value, str | float | int) or np.ndim(value) == 0
    words: list[object] = [value] if bare else list(cast(Sequence[object], value))
    if stem == "FNAME" and words:
        word = words[0]
        file = PurePosixPath(str(word).replace("\\", "/")).name
        if not _FILE_NAME.fullmatch(file):
            raise InputError(
                f"template value FNAME is {str(word)[:80]!r}", "give the name of a mesh file, as in '03.obj'"
            )
        return [file]
    if stem == "COLOR" and len(words) == 1 and isinstance(words[0], str):
        if words[0] not in COLORS:
            raise UnknownNameError("color", words[0], COLORS)
        return list(COLORS[words[0]])
    numbers: Row = [_parse_number(stem, index, word) for index, word in enumerate(words)]
    return numbers * count if bare and not isinstance(value, str) else numbers


def _parse_number(stem: str, index: int, value: object) -> float:
    try:
        number = float(cast(float, value))
    except (TypeError, ValueError):
        number = math.nan
    if not abs(number) < 1e6:
        raise InputError(f"template value {stem}{index} is {str(value)[:80]!r}", "give a finite number (of metres)")
    return number
