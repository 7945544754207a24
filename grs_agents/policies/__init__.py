"""Routing policies: who decides whether the program or its tests are at fault."""

from grs_agents.policies.load import POLICIES, load_policy
from grs_agents.policies.types import Policy, Routed, RoutingContext, RoutingDecision, failures

__all__ = ["POLICIES", "Policy", "Routed", "RoutingContext", "RoutingDecision", "failures", "load_policy"]
