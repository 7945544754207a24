"""Filled URDF templates, kept by name in this process; and the library that programs see when they name none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from grs_agents.library import Library, ObjectModel
from grs_agents.sim.arms import DEFAULT


@dataclass
class _Defaults:
    library: Library | None = None
    seed: int = 0
    robot: str = DEFAULT


_defaults = _Defaults()
_filled: dict[str, ObjectModel] = {}


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


def fill(library: Library, template: str, replace: Mapping[str, Sequence[float]]) -> str:
    """Fill a template and give the result a name that ``filled_model`` knows.

    Raises:
        UnknownNameError: the library has no such template.
        InputError: a value is not a finite number.
    """
    base = asset_name(template, library)
    values = {stem: tuple(float(value) for value in numbers) for stem, numbers in replace.items()}
    model = library.filled(base, values)
    label = ",".join(f"{stem}={'x'.join(f'{value:.4g}' for value in values[stem])}" for stem in sorted(values))
    name = f"{base}#{label}" if label else base
    _filled[name] = model
    return name


def unsure(library: Library, template: str, replace: Mapping[str, Sequence[float]]) -> list[str]:
    """One clause for each value of a template that had to be assumed: left out, unknown to it, or negative."""
    defaults = library.template_defaults(asset_name(template, library))
    short = {
        stem: values[len(replace.get(stem, ())) :]
        for stem, values in defaults.items()
        if len(replace.get(stem, ())) < len(values) and stem != "COLOR"
    }
    if "COLOR" in defaults and "COLOR" not in replace:
        short["COLOR"] = defaults["COLOR"]
    found = [f"{stem} left out takes its default {_row(values)}" for stem, values in short.items()]
    known = {*defaults, "HALF", "INSET", "SCALE", "FNAME"}
    found += [f"{stem} is no placeholder of it, ignored" for stem in replace if stem not in known]
    negative = [stem for stem in replace if stem in ("DIM", "HALF") and any(value < 0 for value in replace[stem])]
    return found + [f"{stem} has negative lengths, taken without their sign" for stem in negative]


def positive(replace: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """The values of a template with lengths made positive: box corners in the wrong order give negative ones."""
    return {
        stem: tuple(abs(float(value)) if stem in ("DIM", "HALF") else float(value) for value in values)
        for stem, values in replace.items()
    }


def listed(values: Mapping[str, Sequence[float]]) -> str:
    """Placeholders and their values in words."""
    return ", ".join(f"{stem} {_row(numbers)}" for stem, numbers in values.items())


def _row(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{number:.4g}' for number in numbers)})"


def filled_model(name: str) -> ObjectModel | None:
    """The shapes of a filled template, None for any other name."""
    return _filled.get(name)
