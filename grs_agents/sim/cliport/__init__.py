"""What generated programs import: CLIPort's Task, Environment, utilities and PyBullet's calls."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
