"""Values that are safe to write as one line of JSON, whatever a model or a program put into them."""

import math
from typing import Annotated, Any, cast

from pydantic import BeforeValidator
from pydantic_core import to_jsonable_python


def encodable(value: Any) -> Any:
    """``value`` with lone surrogates replaced if it is a string: UTF-8 cannot hold them, models do write them."""
    return value.encode("utf-8", "replace").decode("utf-8") if isinstance(value, str) else value


def _as_list(value: Any) -> Any:
    """What numpy arrays and scalars are as plain Python; anything else as its ``repr``."""
    convert = getattr(value, "tolist", None)
    return convert() if callable(convert) else repr(value)


def _encodable_tree(value: Any) -> Any:
    if isinstance(value, dict):
        return {encodable(key): _encodable_tree(item) for key, item in cast("dict[Any, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_encodable_tree(item) for item in cast("list[Any]", value)]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return encodable(value)


def plain(value: Any) -> Any:
    """``value`` as plain JSON data: tuples become lists, paths and NaN strings, models and arrays their content."""
    # before, since pydantic refuses keys that are not UTF-8; after, for what models and arrays held
    return _encodable_tree(to_jsonable_python(_encodable_tree(value), fallback=_as_list))


def brief(value: Any, depth: int = 2) -> Any:
    """``value`` as plain JSON data of a few words; of long texts and lists, and of what lies deep, only the size."""
    value = plain(value)
    if isinstance(value, str) and ("\n" in value or len(value) > _LONG):
        return f"{len(value.splitlines())} lines, {len(value)} characters"
    if isinstance(value, list):
        items = cast("list[Any]", value)
        short = depth > 0 and len(items) <= _FEW and not any(isinstance(item, list | dict) for item in items)
        return [brief(item, 0) for item in items] if short else f"{len(items)} items"
    if isinstance(value, dict):
        fields = cast("dict[str, Any]", value)
        if depth == 0 or len(fields) > _MANY:
            return f"{len(fields)} fields"
        return {key: brief(item, depth - 1) for key, item in fields.items()}
    return value


_LONG, _FEW, _MANY = 160, 4, 16
Text = Annotated[str, BeforeValidator(encodable)]
"""A string that UTF-8 can hold."""
JsonObject = Annotated[dict[str, Any], BeforeValidator(plain)]
"""A JSON object; equal to itself after a trip through a file."""
