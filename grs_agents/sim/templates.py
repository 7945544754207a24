"""Filled URDF templates, kept by name in this process; and the library that programs see when they name none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from grs_agents.library import Library
from grs_agents.sim import utils
from grs_agents.sim.arms import DEFAULT
from grs_agents.sim.episode import SimulationError

Values = Mapping[str, tuple[float | str, ...]]


@dataclass(frozen=True)
class Filling:
    """A template and the values of its placeholders."""

    template: str
    values: Values


@dataclass
class _Defaults:
    library: Library | None = None
    seed: int = 0
    robot: str = DEFAULT


_defaults = _Defaults()
_filled: dict[str, Filling] = {}


def configure(library: Library | None = None, seed: int = 0, robot: str = DEFAULT) -> None:
    """Say which library, seed and robot an ``Environment`` uses when its caller, e.g. a test program, names none."""
    _defaults.library, _defaults.seed, _defaults.robot = library, seed, robot


def default_library() -> Library:
    """The library given to ``configure``, else the one shipped with GRS."""
    if _defaults.library is None:
        _defaults.library = Library()
    return _defaults.library


def default_seed() -> int:
    """The seed given to ``configure``, else 0."""
    return _defaults.seed


def default_robot() -> str:
    """The robot given to ``configure``, else the UR5e."""
    return _defaults.robot


def asset_name(name: str, library: Library) -> str:
    """The library's name for a URDF that may be written with folders in front, as in ``assets_root + name``."""
    parts = PurePosixPath(str(name).replace("\\", "/")).parts
    for start in range(len(parts)):
        candidate = "/".join(parts[start:])
        if candidate in library or candidate in _filled:
            return candidate
    return str(name)


def fill(library: Library, template: str, replace: Mapping[str, Any]) -> str:
    """Fill a template and give the result a name that ``filled`` knows; what is no template keeps its own name.

    Raises:
        UnknownNameError: the library has no such template.
        InputError: a value is not a finite number.
    """
    base = asset_name(template, library)
    known = library.template_defaults(base)
    if not known:
        return base
    values = {stem: value for stem, value in plain(replace).items() if stem in known or stem == "HALF"}
    library.filled(base, values)
    label = ",".join(f"{stem}={'x'.join(_short(value) for value in values[stem])}" for stem in sorted(values))
    name = f"{base}#{label}" if label else base
    _filled[name] = Filling(base, values)
    return name


def plain(replace: Mapping[str, Any]) -> Values:
    """The values of a template as numbers and file names.

    Lengths are made positive (box corners in the wrong order give negative ones), a colour may be a name, a single
    number or name stands for a row of one, and of a file name the last two parts count.

    Raises:
        InputError: a value is neither a number nor a name.
    """
    return {stem: _plain(stem, value) for stem, value in replace.items()}


def _plain(stem: str, value: Any) -> tuple[float | str, ...]:
    if stem == "COLOR" and isinstance(value, str):
        if value not in utils.COLORS:
            raise SimulationError(f"colour {value!r} is unknown", f"use one of {', '.join(sorted(utils.COLORS))}")
        value = utils.COLORS[value]
    row: list[Any] = [value] if isinstance(value, str) or np.isscalar(value) else list(value)
    found: list[float | str] = []
    for item in row:
        if isinstance(item, str):
            found.append("/".join(PurePosixPath(item.replace("\\", "/")).parts[-2:]))
            continue
        try:
            number = float(item)
        except (TypeError, ValueError) as error:
            raise SimulationError(f"fill_template: {stem} holds {item!r}", "give numbers") from error
        found.append(abs(number) if stem.startswith(("DIM", "HALF", "SCALE")) else number)
    return tuple(found)


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def unsure(library: Library, template: str, replace: Mapping[str, Any]) -> list[str]:
    """One clause for each value of a template that had to be assumed: left out, unknown to it, or negative."""
    defaults = library.template_defaults(asset_name(template, library))
    if not defaults:
        return ["it is no template, used as it is"]
    given = {stem: len(row) for stem, row in plain(replace).items()}
    found: list[str] = []
    for stem, row in defaults.items():
        count = given.get(stem, 0)
        if count < len(row) and not (stem == "COLOR" and count >= 3):
            found.append(f"{stem} left out takes its default {_row(row[count:])}")
    known = {*defaults, "HALF", "INSET", "SCALE", "FNAME"}
    found += [f"{stem} is no placeholder of it, ignored" for stem in replace if stem not in known]
    negative = [stem for stem in given if stem in known and stem != "COLOR" and _has_negative(replace[stem])]
    return found + [f"{stem} has negative lengths, taken without their sign" for stem in negative]


def _has_negative(values: Any) -> bool:
    row: list[Any] = [values] if isinstance(values, str) or np.isscalar(values) else list(values)
    return any(not isinstance(value, str) and float(value) < 0 for value in row)


def listed(values: Values) -> str:
    """Placeholders and their values in words."""
    return ", ".join(f"{stem} {_row(row)}" for stem, row in values.items())


def _row(row: Sequence[float | str]) -> str:
    return f"({', '.join(_short(value) for value in row)})"


def filled(name: str) -> Filling | None:
    """What a filled template's name stands for, None for any other name."""
    return _filled.get(name)
