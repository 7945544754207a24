"""Configuration: one TOML file, ``--set`` and the environment become one frozen ``Config``."""

from grs_agents.base.config.schema import Limits as Limits
