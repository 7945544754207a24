"""What happened in a run: typed events and the log they are written to. Everything people see is made from these."""

from grs_agents.trace.events import (
    EVENT,
    Decision,
    Event,
    Finding,
    NodeEnded,
    NodeStarted,
    Note,
    ProgramVersion,
    Prompt,
    Reply,
    Rollout,
    RunEnded,
    RunStarted,
    SceneStage,
    TaskDefined,
    TestsRun,
    event_schema,
)
from grs_agents.trace.log import EventLog, Subscriber, read_events
from grs_agents.trace.values import brief

__all__ = [
    "EVENT",
    "Decision",
    "Event",
    "EventLog",
    "Finding",
    "NodeEnded",
    "NodeStarted",
    "Note",
    "ProgramVersion",
    "Prompt",
    "Reply",
    "Rollout",
    "RunEnded",
    "RunStarted",
    "SceneStage",
    "Subscriber",
    "TaskDefined",
    "TestsRun",
    "brief",
    "event_schema",
    "read_events",
]
