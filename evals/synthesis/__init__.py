"""Synthesised scenes with everything known about them, to measure perception on."""

from evals.synthesis.clutter import SynthesisError
from evals.synthesis.scene import Recipe, SynthesisedScene, recipes, synthesise
from evals.synthesis.sensors import SENSORS, SensorKind

__all__ = ["SENSORS", "Recipe", "SensorKind", "SynthesisError", "SynthesisedScene", "recipes", "synthesise"]
