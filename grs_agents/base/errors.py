"""The errors a user sees: each names the value, the bound or the valid choices, and the remedy."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

_FEW, _NEAREST = 20, 5
"""Most valid names that a message lists; of more it lists the nearest few."""

_ALIKE = 0.6
"""Least similarity, 0..1, of a name to a valid name for the suggestion of a typing error."""


class GrsError(Exception):
    """An error for a reader: the fault, with value and bound, and the remedy (an imperative)."""

    exit_status = 3

    def __init__(self, message: str, remedy: str = "") -> None:
        self.message = " ".join(message.split())
        self.remedy = " ".join(remedy.split())
        super().__init__(f"{self.message}; {self.remedy}" if self.remedy else self.message)

    def __reduce__(self) -> tuple[Any, ...]:
        """The error as it is, for other processes: constructors of subclasses take other arguments."""
        return Exception.__new__, (type(self), *self.args), self.__dict__


class InputError(GrsError):
    """The user's files, folders or arguments are at fault."""

    exit_status = 2


class OutputError(InputError):
    """The system refuses to write: no space, no permission, or a read-only disk."""


class ConfigError(InputError):
    """The user's configuration is at fault."""


class UnknownNameError(ConfigError):
    """A name that nothing has; the message lists the names that exist, nearest first."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], why: str = "") -> None:
        names = sorted(set(valid))
        near = get_close_matches(name, names, n=_NEAREST, cutoff=0.3)
        count = len(names) if len(names) <= _FEW else _NEAREST
        shown = (near + [candidate for candidate in names if candidate not in near])[:count]
        more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
        meant = suggest_name(name, names)
        remedy = f"{meant}use one of: {', '.join(shown) or '(none)'}{more}"
        super().__init__(f"unknown {kind} {name[:80]!r}{why}", remedy)
        self.kind, self.name, self.valid = kind, name, tuple(names)


def suggest_name(name: str, valid: Iterable[str]) -> str:
    """A question that suggests the most similar valid name, and a space; empty if none is similar."""
    return "".join(f"did you mean {near}? " for near in get_close_matches(name, list(valid), n=1, cutoff=_ALIKE))
