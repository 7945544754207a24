"""Configuration: one TOML file, ``--set`` and the environment become one frozen ``Config``."""

from grs_agents.config.load import UNSAFE, Effective, flat, load_config, validated
from grs_agents.config.model import AuditConfig, Config, Limits, ModelConfig, TableChoice, ToolsConfig

__all__ = [
    "UNSAFE",
    "AuditConfig",
    "Config",
    "Effective",
    "Limits",
    "ModelConfig",
    "TableChoice",
    "ToolsConfig",
    "flat",
    "load_config",
    "validated",
]
