"""CLIPort's names for generated programs: Task, Environment, utilities and PyBullet's calls."""

from grs_agents.sim.cliport import pybullet as p
from grs_agents.sim.cliport import utils
from grs_agents.sim.cliport.task import PublishedTask

__all__ = ["PublishedTask", "p", "utils"]
