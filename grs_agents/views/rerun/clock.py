"""The four timelines, computed from the events alone so that a live and a rebuilt recording agree."""

import math
from dataclasses import dataclass

from grs_agents.trace import Event, NodeStarted

BEAT = 0.1
"""Seconds of ``replay`` between two events inside a node; a node takes whole seconds, at least one."""


@dataclass(frozen=True)
class Moment:
    """One instant on every timeline.

    Attributes:
        replay: seconds into the film of the run: a second a node, real seconds inside rollouts.
        event: sequence number of the event.
        attempt: fixes made so far.
        simulated: simulated seconds of all rollouts so far.
    """

    replay: float = 0.0
    event: int = 0
    attempt: int = 0
    simulated: float = 0.0


class Clock:
    """Turns events into moments."""

    def __init__(self) -> None:
        self.now = Moment()

    def tick(self, event: Event) -> Moment:
        """The moment at which ``event`` is shown."""
        replay = self.now.replay + BEAT
        if isinstance(event, NodeStarted):
            replay = float(math.ceil(round(replay, 6)))
        self.now = Moment(round(replay, 6), event.sequence, event.attempt, self.now.simulated)
        return self.now

    def play(self, seconds: float) -> None:
        """Let ``seconds`` of a rollout go by."""
        now = self.now
        self.now = Moment(now.replay + seconds, now.event, now.attempt, now.simulated + seconds)
