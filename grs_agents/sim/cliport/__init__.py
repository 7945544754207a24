"""What generated programs import: CLIPort's Task, Environment, utilities and PyBullet's calls."""

from grs_agents.sim.cliport.task import PublishedTask as PublishedTask
