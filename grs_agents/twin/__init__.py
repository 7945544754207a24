"""The described scene in MuJoCo: how it comes to rest, and how it compares with the photo."""

from grs_agents.twin.disentangling import Disentangled, Known, disentangled
from grs_agents.twin.fidelity import fidelity
from grs_agents.twin.reconcile import Reconciled, Segment, carriers, reconcile
from grs_agents.twin.report import report_of
from grs_agents.twin.settle import Placed, Rest, settle
from grs_agents.twin.thing import Thing

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
