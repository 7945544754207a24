"""Filled URDF templates, kept by name in this process; and the library that programs see when they name none."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.config import Limits
from grs_agents.errors import InputError
from grs_agents.library import Library, resolve_template, template_stems
from grs_agents.sim.arms import DEFAULT
from grs_agents.sim.instance import LARGEST_VALUE
from grs_agents.sim.world import budget

Values = Mapping[str, tuple[float | str, ...]]
Result = TypeVar("Result")
_REMEMBERED = 512


@dataclass(frozen=True)
class Filling:
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


defaults = Defaults()
_filled: dict[str, Filling] = {}
_known: WeakKeyDictionary[Library, dict[tuple[str, str, str], Any]] = WeakKeyDictionary()


def configure(
    library: Library | None = None,
    seed: int = 0,
    robot: str = DEFAULT,
    limits: Limits | None = None,
    background: str | None = None,
) -> None:
    """Say which library, seed and robot an ``Environment`` uses when its caller, e.g. a test program, names none.

    ``limits`` bound all environments of this process together from now on; None leaves them. ``background`` is the
    library name of what stands fixed around the robot in all of them.
    """
    defaults.library, defaults.seed, defaults.robot, defaults.background = library, seed, robot, background
    if limits is not None:
        budget.limit_call(limits)


def default_library() -> Library:
    """The library given to ``configure``, else the one shipped with GRS."""
    defaults.library = defaults.library or Library()
    return defaults.library


def asset_name(name: str, library: Library) -> str:
    """The library's name for a URDF that may be written with folders in front, as in ``assets_root + name``."""
    for candidate in _path_suffixes(str(name)):
        if candidate in library or candidate in _filled:
            return candidate
    return str(name)


@lru_cache(maxsize=_REMEMBERED)
def _path_suffixes(path: str) -> tuple[str, ...]:
    """A path, then without its first folder, and so on."""
    parts = PurePosixPath(path.replace("\\", "/")).parts
    return tuple("/".join(parts[start:]) for start in range(len(parts)))


def cached_filling(
    library: Library, what: str, template: str, values: Mapping[str, Any], make: Callable[[], Result]
) -> Result:
    """What ``make`` makes of a template of a library and values for it; made anew only if it was not lately."""
    if not all(_is_exact(value) for value in values.values()):
        return make()
    key, known = (what, template, repr(dict(values))), _known.setdefault(library, {})
    if key not in known:
        made = make()
        if len(known) >= _REMEMBERED:
            known.clear()
        known[key] = made
    result: Result = known[key]
    return result


def _is_exact(value: Any) -> bool:
    """Whether ``repr`` tells a value from any other: numbers and words, not arrays, which it rounds."""
    if isinstance(value, list | tuple):
        return all(isinstance(part, float | int | str) for part in cast(Sequence[Any], value))
    return isinstance(value, float | int | str)


def fill(library: Library, template: str, replace: Mapping[str, Any]) -> str:
    """Fill a template and give the result a name that ``filling_of`` knows; what is no template keeps its own name.

    Raises ``UnknownNameError`` for no such template, ``InputError`` for a bad number, colour or file name.
    """
    base, before = asset_name(template, library), {}
    if base in _filled:  # a program that overwrites the template's name with the result fills that again
        base, before = _filled[base].template, _filled[base].values
    preset = library.template_defaults(base)
    if not preset:
        return base
    for row in replace.values():
        _array(row)
    values = resolve_template({**before, **_with_positive_lengths(replace, preset)}, preset)[0]
    _check_lengths(base, values)
    library.filled(base, values)
    name = f"{base}#{sorted(values.items())}"
    _filled[name] = Filling(base, values)
    return name


def fill_noted(library: Library, template: str, replace: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """As ``fill``, and what ``assumptions`` says of it."""
    return cached_filling(
        library,
        "name",
        template,
        replace,
        lambda: (fill(library, template, replace), tuple(assumptions(library, template, replace))),
    )


def _check_lengths(template: str, values: Values) -> None:
    for stem, row in values.items():
        largest = max((abs(value) for value in row if not isinstance(value, str)), default=0.0)
        if largest > LARGEST_VALUE:
            raise InputError(f"{template}: {stem} is {_format_row(row)}", f"give metres, at most {LARGEST_VALUE:g}")


def assumptions(library: Library, template: str, replace: Mapping[str, Any]) -> list[str]:
    """One clause for each value of a template that had to be assumed: left out, unknown to it, or negative."""
    base = asset_name(template, library)
    if base in _filled:
        return []
    preset = library.template_defaults(base)
    if not preset:
        return ["it is no template, used as it is"]
    known, assumed = template_stems(preset), resolve_template(_with_positive_lengths(replace, preset), preset)[1]
    clauses = [f"{stem} left out takes its default {_format_row(row)}" for stem, row in assumed.items()]
    clauses += [f"{stem} is no placeholder of it, ignored" for stem in replace if stem not in known]
    negative = [stem for stem in replace if stem in known and _is_length(stem, preset) and _has_negative(replace[stem])]
    return clauses + [f"{stem} has negative lengths, taken without their sign" for stem in negative]


def _is_length(stem: str, preset: Values) -> bool:
    """Whether a stem speaks of lengths; a template without ``DIM``, a corner, has positions under such names."""
    return "DIM" in preset and stem.startswith(("DIM", "HALF", "SCALE"))


def _with_positive_lengths(replace: Mapping[str, Any], preset: Values) -> dict[str, Any]:
    """Lengths made positive: box corners in the wrong order give negative ones."""
    return {
        stem: np.abs(value).tolist() if _is_length(stem, preset) and _has_negative(value) else value
        for stem, value in replace.items()
    }


def _has_negative(values: Any) -> bool:
    numbers = np.atleast_1d(_array(values))
    return numbers.dtype.kind in "if" and bool((numbers < 0).any())


def _array(values: Any) -> npt.NDArray[Any]:
    """A row of a template's values; raises ``InputError`` for lists of several lengths inside it."""
    try:
        return np.asarray(values)
    except ValueError as error:
        raise InputError(f"template values {str(values)[:80]} are no row of numbers", "give (x, y, z)") from error


def describe_values(values: Values) -> str:
    """Placeholders and their values in words."""
    return ", ".join(f"{stem} {_format_row(row)}" for stem, row in values.items())


def _format_row(row: Sequence[float | str]) -> str:
    return f"({', '.join(value if isinstance(value, str) else f'{value:.4g}' for value in row)})"


def filling_of(name: str) -> Filling | None:
    """What a filled template's name stands for, None for any other name."""
    return _filled.get(name)
