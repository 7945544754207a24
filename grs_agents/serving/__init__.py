"""Servers: the graphs for LangGraph's own server, and what agents of others call over the Model Context Protocol."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
