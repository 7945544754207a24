"""One run: its folder, its record, its checkpoints."""

from grs_agents.run.check import CheckOrder, check
from grs_agents.run.execute import UnexpectedError, Views, execute
from grs_agents.run.opening import Order
from grs_agents.run.record import RunRecord, read_record, versions

__all__ = [
    "CheckOrder",
    "Order",
    "RunRecord",
    "UnexpectedError",
    "Views",
    "check",
    "execute",
    "read_record",
    "versions",
]
