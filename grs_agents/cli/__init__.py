"""The ``grs`` command."""

from grs_agents.cli.entry import main

__all__ = ["main"]
