"""The record of a run: typed events and their log. All views are made from these."""

from grs_agents.base.trace.log import read_events as read_events
