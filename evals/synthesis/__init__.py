"""Synthesised scenes with full ground truth, to measure perception."""

from evals.synthesis.clutter import SynthesisError
from evals.synthesis.scene import Recipe, SynthesisedScene, recipes, synthesise
from evals.synthesis.sensors import SENSORS, SensorKind

__all__ = ["SENSORS", "Recipe", "SensorKind", "SynthesisError", "SynthesisedScene", "recipes", "synthesise"]
