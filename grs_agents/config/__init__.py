"""Configuration: one TOML file, ``--set`` and the environment become one frozen ``Config``."""

from grs_agents.config.load import UNSAFE, Effective, load_config, validated
from grs_agents.config.model import AuditConfig, Config, LimitsConfig, ModelConfig, ToolsConfig

__all__ = [
    "UNSAFE",
    "AuditConfig",
    "Config",
    "Effective",
    "LimitsConfig",
    "ModelConfig",
    "ToolsConfig",
    "load_config",
    "validated",
]
