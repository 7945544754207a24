"""Servers: the graphs for LangGraph's own server, and what agents of others call over the Model Context Protocol."""
