"""Perception measured against scenes of which the truth is known."""
