"""Variations of a task: the same instance with its things elsewhere, heavier, in another light, among others."""

from grs_agents.sim.variation.types import Variation as Variation
from grs_agents.sim.variation.vary import vary_instance as vary_instance
