"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""

from grs_agents.perception.settling.collision_repair import Disentangled, Known, disentangled
from grs_agents.perception.settling.reconciliation import Reconciled, Segment, carriers, reconcile
from grs_agents.perception.settling.settling import Placed, Rest, Thing, settle
from grs_agents.perception.settling.twin_report import fidelity, report_of

__all__ = [
    "Disentangled",
    "Known",
    "Placed",
    "Reconciled",
    "Rest",
    "Segment",
    "Thing",
    "carriers",
    "disentangled",
    "fidelity",
    "reconcile",
    "report_of",
    "settle",
]
