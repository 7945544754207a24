"""Configuration: one TOML file, ``--set`` and the environment become one frozen ``Config``."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
