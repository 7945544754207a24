"""A run as one HTML page: task, verdict, photo and film, then every step with its prompts, replies and changes."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
