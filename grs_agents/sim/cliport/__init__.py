"""CLIPort's names for generated programs: Task, Environment, utilities and PyBullet's calls."""

from grs_agents.sim.cliport.task import PublishedTask as PublishedTask
