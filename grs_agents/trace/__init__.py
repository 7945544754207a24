"""What happened in a run: typed events and the log they are written to. Everything people see is made from these."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
