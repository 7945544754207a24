"""Messages on refused values: object, quantity, unit and bound."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, cast

from pydantic import ValidationError

_POSE: Final = ("pose", "targets", "parent_frame", "child_frame")
_POSITION, _ROTATION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_COLOR: Final = ("red", "green", "blue", "alpha")
_UNITS: Final = {
    "distance": "m",
    "friction": "",
    "hz": "Hz",
    "mass": "kg",
    "pos_eps": "m",
    "rot_eps": "rad",
    "symmetries": "rad",
    "timestep": "s",
}
"""Units of the numbers that are no lengths, by field."""
_LISTED: Final = {"goals": "goal", "ties": "tie", "zones": "zone", "targets": "target", "warnings": "warning"}
_BOUNDS: Final = {"less_than_equal": ("le", "at most"), "greater_than_equal": ("ge", "at least")} | {
    "less_than": ("lt", "less than"),
    "greater_than": ("gt", "more than"),
}
_NO_NUMBER: Final = ("finite_number", "float_type", "float_parsing", "int_type", "int_parsing", "int_from_float")
_SHOULD: Final = "Input should be "
"""Start of pydantic's requirements."""
_SURELY_NO_METRES: Final = 10.0
"""Metres: beyond any coordinate on a table, but not in millimetres or centimetres."""


def describe_first_error(error: ValidationError, subject: str = "", data: object = None) -> str:
    """Message on the first fault of a task instance or a part of it, with the number of others.

    Args:
        error: the validation error.
        subject: receiver of the value, e.g. ``add_object('block/block.urdf')``.
        data: the validated whole, from which objects have their names.
    """
    faults = error.errors(include_url=False)
    location = tuple(part for part in faults[0]["loc"] if not isinstance(part, str) or part.isidentifier())
    owner = ", ".join(filter(None, [subject, *_name_owners(location, data)]))
    quantity, unit = _name_quantity(location)
    message = _describe_fault(cast("dict[str, Any]", faults[0]), quantity, unit)
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return f"{f'{owner}: ' if owner else ''}{message}{more}"[:1000]


def _describe_fault(fault: Mapping[str, Any], quantity: str, unit: str) -> str:
    kind, value, context = str(fault["type"]), fault["input"], fault.get("ctx", {})
    shown = f"{value:g}" if isinstance(value, float) else repr(value)[:80]
    message = str(fault["msg"])
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        of = f" {unit}" if unit else ""
        text = f"{quantity} = {shown}{of}, must be {words} {context[name]:.10g}{of}"
        if unit == "m" and isinstance(value, float | int) and not abs(value) < _SURELY_NO_METRES:
            text += f"; give metres: {value:g} mm are {value / 1000:g}"
    elif kind in _NO_NUMBER:
        number = "a whole number" if kind.startswith("int") else "a finite number"
        text = f"{quantity} is {shown}, must be {number}{f' ({unit})' if unit else ''}"
    elif kind == "value_error":
        text = message.removeprefix("Value error, ")
    elif kind == "missing":
        text = f"{quantity} is missing"
    elif kind == "extra_forbidden":
        text = f"there is no field {quantity}"
    elif kind == "literal_error":
        text = f"{quantity} is {shown}, must be {context['expected']}"
    elif kind in ("too_long", "too_short"):
        bound = f"at most {context['max_length']}" if kind == "too_long" else f"at least {context['min_length']}"
        text = f"{quantity} has {context['actual_length']} entries, must have {bound}"
    elif quantity and message.startswith(_SHOULD):
        text = f"{quantity} is {shown}, must be {message.removeprefix(_SHOULD)}"
    else:
        text = f"{quantity}: {message[:1].lower()}{message[1:]}" if quantity else message
    return text


def _name_owners(location: Sequence[str | int], data: object) -> list[str]:
    """Owners of a faulty value, outermost first: an object by id and asset, a goal by its number from 1."""
    named: list[str] = []
    for name, number in pairwise(location):
        if not isinstance(number, int):
            continue
        if name == "objects":
            rows = cast("Mapping[str, Any]", data).get("objects") if isinstance(data, Mapping) else None
            listed = cast("list[Any]", rows) if isinstance(rows, list) else []
            row = listed[number] if number < len(listed) else None
            item = cast("Mapping[str, Any]", row if isinstance(row, Mapping) else {})
            asset = item.get("asset")
            named.append(f"object {item.get('id', number)}" + (f" ({str(asset)[:80]})" if asset else ""))
        elif name in _LISTED:
            named.append(f"{_LISTED[str(name)]} {number + 1}")
    return named


def _name_quantity(location: Sequence[str | int]) -> tuple[str, str]:
    """Name and unit of a value; the unit is empty for a pure number."""
    field = next((str(part) for part in reversed(location) if isinstance(part, str)), "")
    at = len(location) - 1 - next((index for index, part in enumerate(reversed(location)) if part == field), 0)
    numbers = [part for part in location[at + 1 :] if isinstance(part, int)]
    if field == "targets":
        numbers = numbers[1:]
    if field in _POSE and len(numbers) == 2 and numbers[0] in (0, 1):
        names = _ROTATION if numbers[0] else _POSITION
        return (names[numbers[1]] if numbers[1] < len(names) else field), "" if numbers[0] else "m"
    if field in ("position", "target") and numbers[:1] and numbers[0] < len(_POSITION):
        return f"{field} {_POSITION[numbers[0]]}", "m"
    if field == "size" and numbers[:1] and numbers[0] < len(_POSITION):
        return f"size {_POSITION[numbers[0]]}", "m"
    if field.endswith("color") and numbers[:1] and numbers[0] < len(_COLOR):
        return f"{field} {_COLOR[numbers[0]]}", ""
    if "fill" in location and field != "fill":
        return f"fill {field}", "" if field == "COLOR" else "m"
    return field, _UNITS.get(field, "")
