"""Configuration: a TOML file, ``--set`` and the environment become a frozen ``Config``."""

from grs_agents.base.config.schema import Limits as Limits
