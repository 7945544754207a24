"""Routing policies decide whether the program or its tests are at fault.

A policy sees the two programs, the test report, the audit and the static findings, and decides which of them to fix.
"""

from grs_agents.graph.policies.types import RoutingContext as RoutingContext
from grs_agents.graph.policies.types import RoutingDecision as RoutingDecision
