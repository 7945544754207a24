"""Chat models: one seam for intelligence, from the embedded ``offline`` model to any provider."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
