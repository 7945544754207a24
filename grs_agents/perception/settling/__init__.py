"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""

from grs_agents.perception.settling.collision_repair import CollisionRepairs, KnownObject, repair_collisions
from grs_agents.perception.settling.reconciliation import Reconciled, Segment, reconcile_segments, supporting_segments
from grs_agents.perception.settling.settling import Placed, PlacedObject, RestState, settle
from grs_agents.perception.settling.twin_report import fidelity, report_of

__all__ = [
    "CollisionRepairs",
    "KnownObject",
    "Placed",
    "PlacedObject",
    "Reconciled",
    "RestState",
    "Segment",
    "fidelity",
    "reconcile_segments",
    "repair_collisions",
    "report_of",
    "settle",
    "supporting_segments",
]
