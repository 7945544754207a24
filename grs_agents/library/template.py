"""URDF templates: placeholders ``DIM0``, ``HALF1``, ``COLOR3`` become numbers, as in CLIPort."""

import re
from collections.abc import Mapping, Sequence

from grs_agents.errors import InputError

WALL = 0.005
"""Thickness in m of the walls and floors of templates."""
_PLACEHOLDER = re.compile(r"\b(DIM|HALF|INSET|COLOR)(\d)")


def fill_template(
    text: str, replace: Mapping[str, Sequence[float | str]], defaults: Mapping[str, Sequence[float]] | None = None
) -> str:
    """The URDF text of a template with its placeholders replaced.

    ``{"DIM": (x, y, z)}`` puts x for ``DIM0``, y for ``DIM1``, z for ``DIM2``. What ``replace`` leaves out
    comes from ``defaults``; ``HALF`` (half of ``DIM``) and ``INSET`` (``HALF`` less half a wall) follow
    from ``DIM``.

    Args:
        text: the template.
        replace: values (m; colours 0..1) by placeholder stem.
        defaults: the template's documented defaults.

    Raises:
        InputError: a value is not a finite number, or a placeholder is left without a value.
    """
    values = {stem: [float(number) for number in numbers] for stem, numbers in (defaults or {}).items()}
    for stem, numbers in replace.items():
        given = [_number(stem, index, number) for index, number in enumerate(numbers)]
        values[stem] = given + values.get(stem, [])[len(given) :]
    dimensions = values.get("DIM", [])
    derived = {"HALF": [d / 2 for d in dimensions], "INSET": [max(0.0, d - WALL) / 2 for d in dimensions]}
    for stem, numbers in (derived | values).items():
        for index, number in enumerate(numbers):
            text = text.replace(f"{stem}{index}", f"{number:.6g}")
    left = sorted({match.group(0) for match in _PLACEHOLDER.finditer(text)})
    if left:
        raise InputError(f"template placeholder {left[0]} has no value", f"give {', '.join(left)}")
    return text


def _number(stem: str, index: int, value: float | str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"template value {stem}{index} is {value!r}", "give a number") from None
    if not abs(number) < 1e6:
        raise InputError(f"template value {stem}{index} is {number}", "give a finite number of metres")
    return number
