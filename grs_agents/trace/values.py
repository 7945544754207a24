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


Text = Annotated[str, BeforeValidator(encodable)]
"""A string that UTF-8 can hold."""
JsonObject = Annotated[dict[str, Any], BeforeValidator(plain)]
"""A JSON object; equal to itself after a trip through a file."""
