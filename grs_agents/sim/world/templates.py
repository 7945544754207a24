"""Filled URDF templates, kept by name in this process; and the library that programs see when they name none."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.urdf_templates import known_placeholder_stems, resolve_template_values
from grs_agents.sim.arms.registry import DEFAULT, get_arm
from grs_agents.sim.instance.task_instance import LARGEST_VALUE, InstanceObject
from grs_agents.sim.world import budget

Values = Mapping[str, tuple[float | str, ...]]
Result = TypeVar("Result")
_REMEMBERED = 512


@dataclass(frozen=True)
class FilledTemplate:
    """A template and the values of its placeholders."""

    template: str
    values: Values


@dataclass
class Defaults:
    """What an ``Environment`` takes where its caller names nothing; ``default_library()`` gives the library."""

    library: Library | None = None
    seed: int = 0
    robot: str = DEFAULT
    background: str | None = None
    bystanders: tuple[InstanceObject, ...] = ()


defaults = Defaults()
_filled: dict[str, FilledTemplate] = {}
_known: WeakKeyDictionary[Library, dict[tuple[str, str, str], Any]] = WeakKeyDictionary()


def set_environment_defaults(
    library: Library | None = None,
    seed: int = 0,
    robot: str = DEFAULT,
    limits: Limits | None = None,
    background: str | None = None,
    bystanders: Sequence[InstanceObject] = (),
) -> None:
    """Say which library, seed and robot an ``Environment`` uses when its caller, e.g. a test program, names none.
    ``limits`` bound all environments of this process together from now on; None leaves them. ``background`` is the
    library name of what stands fixed around the robot in all of them, ``bystanders`` stand on the table before a
    program sets up its scene."""
    defaults.library, defaults.seed, defaults.robot, defaults.background = library, seed, robot, background
    defaults.bystanders = tuple(bystanders)
    if limits is not None:
        budget.set_call_limits(limits)


def prepare_process() -> None:
    """Make what every simulation needs, so that the processes that are forked from this one have it."""
    Library()
    _ = get_arm().link_names


def default_library() -> Library:
    """The library given to ``set_environment_defaults``, else the one shipped with GRS."""
    defaults.library = defaults.library or Library()
    return defaults.library


def resolve_asset_name(name: str, library: Library) -> str:
    """The library's name for a URDF that may be written with folders in front, as in ``assets_root + name``."""
    for candidate in _path_suffixes(str(name)):
        if candidate in library or candidate in _filled:
            return candidate
    return str(name)


@lru_cache(maxsize=_REMEMBERED)
def _path_suffixes(path: str) -> tuple[str, ...]:
    """A path, then without its first folder, and so on. A template may name its placeholders, as GenSim's do:
    ``box-template_DIM_HALF.urdf``."""
    parts = PurePosixPath(re.sub(r"-template(_[A-Z]+)+\.urdf$", "-template.urdf", path.replace("\\", "/"))).parts
    return tuple("/".join(parts[start:]) for start in range(len(parts)))


def cached_template_result(
    library: Library, what: str, template: str, values: Mapping[str, Any], make: Callable[[], Result]
) -> Result:
    """What ``make`` makes of a template of a library and values for it; made anew only if it was not lately."""
    if not all(_has_exact_repr(value) for value in values.values()):
        return make()
    key, known = (what, template, repr(dict(values))), _known.setdefault(library, {})
    if key not in known:
        made = make()
        if len(known) >= _REMEMBERED:
            known.clear()
        known[key] = made
    result: Result = known[key]
    return result


def _has_exact_repr(value: Any) -> bool:
    """Whether ``repr`` tells a value from any other: numbers and words, not arrays, which it rounds."""
    if isinstance(value, list | tuple):
        return all(isinstance(part, float | int | str) for part in cast(Sequence[Any], value))
    return isinstance(value, float | int | str)


def fill_template(library: Library, template: str, replace: Mapping[str, Any]) -> str:
    """Fill a template; ``find_filling_by_name`` knows the result's name. What is no template keeps its own.
    Raises ``UnknownNameError`` for no such template, ``InputError`` for a bad number, colour or file name."""
    base, before = resolve_asset_name(template, library), {}
    if base in _filled:  # a program that overwrites the template's name with the result fills that again
        base, before = _filled[base].template, _filled[base].values
    preset = library.template_defaults(base)
    if not preset:
        return base
    for row in replace.values():
        _values_to_array(row)
    values = resolve_template_values({**before, **_make_placeholder_lengths_positive(replace, preset)}, preset)[0]
    _check_value_magnitudes(base, values)
    library.load_filled_template(base, values)
    name = f"{base}#{sorted(values.items())}"
    _filled[name] = FilledTemplate(base, values)
    return name


def fill_and_describe_template(
    library: Library, template: str, replace: Mapping[str, Any]
) -> tuple[str, tuple[str, ...]]:
    """As ``fill_template``, and what ``describe_assumed_values`` says of it."""
    return cached_template_result(
        library,
        "name",
        template,
        replace,
        lambda: (fill_template(library, template, replace), tuple(describe_assumed_values(library, template, replace))),
    )


def _check_value_magnitudes(template: str, values: Values) -> None:
    for stem, row in values.items():
        largest = max((abs(value) for value in row if not isinstance(value, str)), default=0.0)
        if largest > LARGEST_VALUE:
            remedy = f"give metres, at most {LARGEST_VALUE:g}"
            if stem == "COLOR":
                remedy = "give red, green and blue in 0..1"
            elif largest >= 10:  # no metres: nothing on a table is as large
                remedy += f": {largest:g} mm are {largest / 1000:g}"
            raise InputError(f"{template}: {stem} is {_format_row(row)}", remedy)


def describe_assumed_values(library: Library, template: str, replace: Mapping[str, Any]) -> list[str]:
    """One clause for each value of a template that had to be assumed: left out, unknown to it, or negative."""
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
    """Whether a stem speaks of lengths; a template without ``DIM``, a corner, has positions under such names."""
    return "DIM" in preset and stem.startswith(("DIM", "HALF", "SCALE"))


def _make_placeholder_lengths_positive(replace: Mapping[str, Any], preset: Values) -> dict[str, Any]:
    """Lengths made positive: box corners in the wrong order give negative ones."""
    return {
        stem: np.abs(value).tolist() if _is_length_placeholder(stem, preset) and _has_negative_value(value) else value
        for stem, value in replace.items()
    }


def _has_negative_value(values: Any) -> bool:
    numbers = np.atleast_1d(_values_to_array(values))
    return numbers.dtype.kind in "if" and bool((numbers < 0).any())


def _values_to_array(values: Any) -> npt.NDArray[Any]:
    """A row of a template's values; raises ``InputError`` for lists of several lengths inside it."""
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
    """What a filled template's name stands for, None for any other name."""
    return _filled.get(name)
