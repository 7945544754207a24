"""The policies by name: built in, by dotted path, or from an entry point."""

import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.policies.asking import AlwaysCode, Hybrid, Llm, Vote
from grs_agents.policies.rules import Rules
from grs_agents.policies.types import Policy

POLICIES: dict[str, type[Policy]] = {
    "llm": Llm,
    "rules": Rules,
    "hybrid": Hybrid,
    "vote": Vote,
    "always_code": AlwaysCode,
}
ENTRY_POINTS = "grs_agents.policies"


def load_policy(name: str) -> Policy:
    """The policy ``name``: built in, ``package.module:Class``, or an entry point in ``grs_agents.policies``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: it cannot be imported or made, or has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    entries = entry_points(group=ENTRY_POINTS)
    if ":" not in name and name not in entries.names:
        raise UnknownNameError("policy", name, [*POLICIES, *entries.names, "package.module:Class"])
    try:
        policy = (_import_object_by_path(name) if ":" in name else entries[name].load())()
    except Exception as error:  # whatever the user's own code raises
        raise ConfigError(
            f"policy {name!r}: {type(error).__name__}: {error}",
            "give package.module:Class of an importable class that is made without arguments",
        ) from error
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.policies.Policy")
    return cast(Policy, policy)


def _import_object_by_path(path: str) -> Any:
    """What ``module:name`` names; the module may lie in the current folder, where Python's own path ends."""
    module, _, attribute = path.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)
    return getattr(import_module(module), attribute)
