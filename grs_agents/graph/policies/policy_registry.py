"""The policies by name: built in, from a content folder, by dotted path, or from an entry point."""

from typing import cast

from grs_agents.base import content
from grs_agents.base.errors import ConfigError
from grs_agents.base.plugins import broken_class_error, load_named_class
from grs_agents.graph.policies.asking import AlwaysCode, Human, Hybrid, Llm, Vote
from grs_agents.graph.policies.rules import Rules
from grs_agents.graph.policies.types import Policy

POLICIES: dict[str, type[Policy]] = {
    "llm": Llm,
    "rules": Rules,
    "hybrid": Hybrid,
    "vote": Vote,
    "always_code": AlwaysCode,
    "human": Human,
}
ENTRY_POINTS = "grs_agents.policies"


def load_policy(name: str) -> Policy:
    """The policy ``name``: built in, the class ``Policy`` of ``policies/NAME.py`` in a content folder,
    ``package.module:Class``, or an entry point in ``grs_agents.graph.policies``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: it cannot be imported or made, or has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    known = [*POLICIES, *content.content_names("policies")]
    make = content.find_class("policies", name, "Policy") or load_named_class("policy", name, ENTRY_POINTS, known)
    try:
        policy = make()
    except Exception as error:  # whatever the user's own code raises
        raise broken_class_error("policy", name, error) from error
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.graph.policies.types.Policy")
    return cast(Policy, policy)
