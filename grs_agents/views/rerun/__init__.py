"""The rerun recording of a run. Importing its modules imports rerun, which is slow."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
