"""What happened in a run: typed events and the log they are written to. Everything people see is made from these."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
