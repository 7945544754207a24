"""Where generated code runs: a process without rights or reach, whose every failure comes back as a value.

The room knows nothing of simulations: its callers name the tools, what a worker imports ahead of time, and
the hooks that a test run calls.
"""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
