"""Servers: the graphs for LangGraph's server, and tools for the Model Context Protocol."""
