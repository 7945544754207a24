"""The budget of a run: tokens, cost and time of its models."""

import time
from itertools import pairwise
from pathlib import Path

from grs_agents.base.config.schema import BudgetConfig
from grs_agents.base.errors import GrsError
from grs_agents.base.trace.events import Reply
from grs_agents.base.trace.log import read_events


class BudgetReached(GrsError):
    """The budget is used up: no further model is called, and the run ends with its results so far."""


def check_budget_left(budget: BudgetConfig, log: Path) -> None:
    """Check that the budget allows a further call; concurrent calls may pass a bound together.

    Args:
        budget: the bounds.
        log: the events of all attempts of the run.

    Raises:
        BudgetReached: a bound is used up.
    """
    if budget == BudgetConfig():
        return
    events = read_events(log)
    replies = [event for event in events if isinstance(event, Reply)]
    waits = (later.time - event.time for event, later in pairwise(events) if later.kind != "run_started")
    seconds = sum(waits) + time.time() - events[-1].time if events else 0.0
    spent = (
        (budget.tokens, sum(reply.input_tokens + reply.output_tokens for reply in replies), "{:,} of {:,} tokens"),
        (budget.cost, sum(reply.cost or 0.0 for reply in replies), "{:.2f} of {:.2f} US dollars"),
        (budget.minutes, seconds / 60, "{:.1f} of {:g} minutes"),
    )
    for most, used, text in spent:
        if most is not None and used >= most:
            raise BudgetReached(f"budget: {text.format(used, most)} used")
