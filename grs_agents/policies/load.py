"""Find a policy by name, dotted path or entry point."""

import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.policies.builtin import AlwaysCode, Llm, Rules
from grs_agents.policies.types import Policy

POLICIES: dict[str, type[Policy]] = {"llm": Llm, "rules": Rules, "always_code": AlwaysCode}
ENTRY_POINTS = "grs_agents.policies"


def load_policy(name: str) -> Policy:
    """The policy ``name``: built in, ``package.module:Class``, or an entry point in ``grs_agents.policies``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: it cannot be imported or made, or has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    found = entry_points(group=ENTRY_POINTS)
    if ":" not in name and name not in found.names:
        raise UnknownNameError("policy", name, [*POLICIES, *found.names, "package.module:Class"])
    try:
        policy = (_named(name) if ":" in name else found[name].load())()
    except Exception as error:  # whatever the user's own code raises
        raise ConfigError(
            f"policy {name!r}: {type(error).__name__}: {error}",
            "give package.module:Class of an importable class that is made without arguments",
        ) from error
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.policies.Policy")
    return cast(Policy, policy)


def _named(path: str) -> Any:
    """What ``module:name`` names; the module may lie in the current folder, where Python's own path ends."""
    module, _, attribute = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    return getattr(import_module(module), attribute)
