"""What a run may still spend on its models."""

import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from grs_agents.base.config.schema import BudgetConfig
from grs_agents.base.errors import GrsError
from grs_agents.base.trace.events import Event, Reply
from grs_agents.base.trace.log import read_events


class BudgetReached(GrsError):
    """The run has spent what it may, so no model is asked any more; it ends with what it has."""


def check_budget_left(budget: BudgetConfig, log: Path) -> None:
    """See that one more call may be made; calls that are under way at once may pass a bound together.

    Args:
        budget: the bounds.
        log: the events of all attempts of the run.

    Raises:
        BudgetReached: one of the bounds is used up.
    """
    if budget == BudgetConfig():
        return
    events = read_events(log)
    replies = [event for event in events if isinstance(event, Reply)]
    spent = (
        (budget.tokens, sum(reply.input_tokens + reply.output_tokens for reply in replies), "{:,} of {:,} tokens"),
        (budget.cost, sum(reply.cost or 0.0 for reply in replies), "{:.2f} of {:.2f} US dollars"),
        (budget.minutes, _sum_attempt_seconds(events) / 60, "{:.1f} of {:g} minutes"),
    )
    for most, used, text in spent:
        if most is not None and used >= most:
            raise BudgetReached(f"budget: {text.format(used, most)} used")


def _sum_attempt_seconds(events: Sequence[Event]) -> float:
    """Of all attempts, without the time between one and the next."""
    waits = (later.time - event.time for event, later in pairwise(events) if later.kind != "run_started")
    return sum(waits) + time.time() - events[-1].time if events else 0.0
