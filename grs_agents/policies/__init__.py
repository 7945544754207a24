"""Routing policies: who decides whether the program or its tests are at fault."""

from grs_agents.policies.load import POLICIES, load_policy
from grs_agents.policies.types import Policy, RoutingContext, RoutingDecision

__all__ = ["POLICIES", "Policy", "RoutingContext", "RoutingDecision", "load_policy"]
