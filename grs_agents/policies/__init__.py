"""Routing policies: who decides whether the program or its tests are at fault.

A policy sees the two programs, the test report, the audit and what shows without a run, and says which of them to fix.
"""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
