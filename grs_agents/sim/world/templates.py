"""Filled URDF templates, kept by name in this process."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.urdf_templates import known_placeholder_stems, resolve_template_values
from grs_agents.sim.instance.task_instance import LARGEST_VALUE

Values = Mapping[str, tuple[float | str, ...]]
Result = TypeVar("Result")
_REMEMBERED = 512


@dataclass(frozen=True)
class FilledTemplate:
    """A template and the values of its placeholders."""

    template: str
    values: Values


_filled: dict[str, FilledTemplate] = {}
_known: WeakKeyDictionary[Library, dict[tuple[str, str, str], Any]] = WeakKeyDictionary()


def resolve_asset_name(name: str, library: Library) -> str:
    """The library's name for a URDF that may be written with folders in front, as in ``assets_root + name``."""
    for candidate in _path_suffixes(str(name)):
        if candidate in library or candidate in _filled:
            return candidate
    return str(name)


@lru_cache(maxsize=_REMEMBERED)
def _path_suffixes(path: str) -> tuple[str, ...]:
    """A path, then without its first folder, and so on.

    Templates lose the placeholders in GenSim's names: ``box-template_DIM_HALF.urdf``.
    """
    parts = PurePosixPath(re.sub(r"-template(_[A-Z]+)+\.urdf$", "-template.urdf", path.replace("\\", "/"))).parts
    return tuple("/".join(parts[start:]) for start in range(len(parts)))


def cached_template_result(
    library: Library, what: str, template: str, values: Mapping[str, Any], make: Callable[[], Result]
) -> Result:
    """Cached result of ``make`` for a template of a library and its values, of the kind ``what``."""
    scalar = (float, int, str)  # whose ``repr`` is exact, unlike that of arrays, which it rounds
    for value in values.values():
        parts: Sequence[Any] = cast(Sequence[Any], value) if isinstance(value, list | tuple) else (value,)
        if not all(isinstance(part, scalar) for part in parts):
            return make()
    key, known = (what, template, repr(dict(values))), _known.setdefault(library, {})
    if key not in known:
        made_now = make()
        if len(known) >= _REMEMBERED:
            known.clear()
        known[key] = made_now
    result: Result = known[key]
    return result


def fill_template(library: Library, template: str, replace: Mapping[str, Any]) -> str:
    """Fill a template; returns a name that ``find_filling_by_name`` resolves. Other assets keep their name.

    Raises ``UnknownNameError`` for an unknown template, ``InputError`` for a bad number, colour or file name.
    """
    base, before = resolve_asset_name(template, library), {}
    if base in _filled:  # a program that overwrites the template's name with the result fills that again
        base, before = _filled[base].template, _filled[base].values
    preset = library.template_defaults(base)
    if not preset:
        return base
    for row in replace.values():
        _values_to_array(row)
    values = resolve_template_values({**before, **_make_placeholder_lengths_positive(replace, preset)}, preset)[0]
    for stem, numbers in values.items():
        largest = max((abs(value) for value in numbers if not isinstance(value, str)), default=0.0)
        if largest > LARGEST_VALUE:
            remedy = f"give metres, at most {LARGEST_VALUE:g}"
            if stem == "COLOR":
                remedy = "give red, green and blue in 0..1"
            elif largest >= 10:  # millimetres: nothing on a table is 10 m large
                remedy += f": {largest:g} mm are {largest / 1000:g}"
            raise InputError(f"{base}: {stem} is {_format_row(numbers)}", remedy)
    library.load_filled_template(base, values)
    name = f"{base}#{sorted(values.items())}"
    _filled[name] = FilledTemplate(base, values)
    return name


def fill_and_describe_template(
    library: Library, template: str, replace: Mapping[str, Any]
) -> tuple[str, tuple[str, ...]]:
    """Results of ``fill_template`` and ``describe_assumed_values``, cached."""
    return cached_template_result(
        library,
        "name",
        template,
        replace,
        lambda: (fill_template(library, template, replace), tuple(describe_assumed_values(library, template, replace))),
    )


def describe_assumed_values(library: Library, template: str, replace: Mapping[str, Any]) -> list[str]:
    """Clauses on the assumed values of a template: those left out, unknown to it, or negative."""
    base = resolve_asset_name(template, library)
    if base in _filled:
        return []
    preset = library.template_defaults(base)
    if not preset:
        return ["it is no template, used as it is"]
    known = known_placeholder_stems(preset)
    _, assumed = resolve_template_values(_make_placeholder_lengths_positive(replace, preset), preset)
    clauses = [f"{stem} left out takes its default {_format_row(row)}" for stem, row in assumed.items()]
    clauses += [f"{stem} is no placeholder of it, ignored" for stem in replace if stem not in known]
    lengths = [stem for stem in replace if stem in known and _is_length_placeholder(stem, preset)]
    negative = [stem for stem in lengths if _has_negative_value(replace[stem])]
    return clauses + [f"{stem} has negative lengths, taken without their sign" for stem in negative]


def _is_length_placeholder(stem: str, preset: Values) -> bool:
    """Whether a placeholder holds lengths; in a template without ``DIM``, a corner, these names hold positions."""
    return "DIM" in preset and stem.startswith(("DIM", "HALF", "SCALE"))


def _make_placeholder_lengths_positive(replace: Mapping[str, Any], preset: Values) -> dict[str, Any]:
    """The values with positive lengths: box corners in the wrong order give negative lengths."""
    return {
        stem: np.abs(value).tolist() if _is_length_placeholder(stem, preset) and _has_negative_value(value) else value
        for stem, value in replace.items()
    }


def _has_negative_value(values: Any) -> bool:
    numbers = np.atleast_1d(_values_to_array(values))
    return numbers.dtype.kind in "if" and bool((numbers < 0).any())


def _values_to_array(values: Any) -> npt.NDArray[Any]:
    """A row of a template's values as an array; raises ``InputError`` for a ragged list."""
    try:
        return np.asarray(values)
    except ValueError as error:
        raise InputError(f"template values {str(values)[:80]} are no row of numbers", "give (x, y, z)") from error


def describe_placeholder_values(values: Values) -> str:
    """Placeholders and their values in words."""
    return ", ".join(f"{stem} {_format_row(row)}" for stem, row in values.items())


def _format_row(row: Sequence[float | str]) -> str:
    return f"({', '.join(value if isinstance(value, str) else f'{value:.4g}' for value in row)})"


def find_filling_by_name(name: str) -> FilledTemplate | None:
    """The filled template of a name, None for any other name."""
    return _filled.get(name)
