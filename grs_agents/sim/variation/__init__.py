"""Variations of a task: the same instance with other poses, masses, light, table top and bystanders."""

from grs_agents.sim.variation.types import Variation as Variation
from grs_agents.sim.variation.vary import vary_instance as vary_instance
