"""Where a known asset stands: pose hypotheses, registration, and what is left over."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
