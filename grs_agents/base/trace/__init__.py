"""What happened in a run: typed events and the log they are written to. Everything people see is made from these."""

from grs_agents.base.trace.log import read_events as read_events
