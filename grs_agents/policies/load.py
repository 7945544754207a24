"""Find a policy by name, dotted path or entry point."""

from importlib import import_module
from importlib.metadata import entry_points
from typing import cast

from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.policies.builtin import AlwaysCode, Llm, Rules
from grs_agents.policies.types import Policy

POLICIES: dict[str, type[Policy]] = {"llm": Llm, "rules": Rules, "always_code": AlwaysCode}
ENTRY_POINTS = "grs_agents.policies"


def load_policy(name: str) -> Policy:
    """The policy ``name``: built in, ``package.module:Class``, or an entry point in ``grs_agents.policies``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: the dotted path cannot be imported, or what it names has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    found = entry_points(group=ENTRY_POINTS)
    if ":" in name:
        module, _, attribute = name.partition(":")
        try:
            factory = getattr(import_module(module), attribute)
        except (ImportError, AttributeError) as error:
            raise ConfigError(
                f"policy {name!r}: {error}", "give package.module:Class of an importable class"
            ) from error
    elif name in found.names:
        factory = found[name].load()
    else:
        raise UnknownNameError("policy", name, [*POLICIES, *found.names, "package.module:Class"])
    policy = factory()
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.policies.Policy")
    return cast(Policy, policy)
