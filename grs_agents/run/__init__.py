"""One run: its folder, its record, its checkpoints."""

from grs_agents.run.bundle_check import CheckOrder, check
from grs_agents.run.execution import Outcome, UnexpectedError, Views, execute
from grs_agents.run.opening import GIVEN, Order, load_graph
from grs_agents.run.record import RunRecord, read_record, versions

__all__ = [
    "GIVEN",
    "CheckOrder",
    "Order",
    "Outcome",
    "RunRecord",
    "UnexpectedError",
    "Views",
    "check",
    "execute",
    "load_graph",
    "read_record",
    "versions",
]
