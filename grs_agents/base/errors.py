"""The errors a user sees: each names the value, the bound or the valid choices, and the remedy."""

from collections.abc import Iterable
from difflib import get_close_matches

_FEW, _NEAREST = 20, 5
"""Of up to so many valid names a message lists all, of more the nearest few."""

_ALIKE = 0.6
"""How alike a name must be to one that there is, 0..1, for it to be taken for a slip of the pen."""


class GrsError(Exception):
    """An error to be read: what is wrong, with value and bound, and what to do about it (an imperative)."""

    exit_status = 3

    def __init__(self, message: str, remedy: str = "") -> None:
        self.message = " ".join(message.split())
        self.remedy = " ".join(remedy.split())
        super().__init__(f"{self.message}; {self.remedy}" if self.remedy else self.message)


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
        shown = (near + [other for other in names if other not in near])[:count]
        more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
        meant = suggest_name(name, names)
        remedy = f"{meant}use one of: {', '.join(shown) or '(none)'}{more}"
        super().__init__(f"unknown {kind} {name[:80]!r}{why}", remedy)
        self.kind, self.name, self.valid = kind, name, tuple(names)


def suggest_name(name: str, valid: Iterable[str]) -> str:
    """The question whether another name was meant, and a space; empty where none is alike."""
    return "".join(f"did you mean {near}? " for near in get_close_matches(name, list(valid), n=1, cutoff=_ALIKE))
