"""The agents: describer, matcher, task author, simulation author, test author, router and the two fixers."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
