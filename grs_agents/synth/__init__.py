"""Synthesised scenes with everything known about them, to measure perception on."""

from grs_agents.synth.clutter import SynthesisError
from grs_agents.synth.scene import Recipe, SynthesisedScene, recipes, synthesise
from grs_agents.synth.sensors import SENSORS, SensorKind

__all__ = ["SENSORS", "Recipe", "SensorKind", "SynthesisError", "SynthesisedScene", "recipes", "synthesise"]
