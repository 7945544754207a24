"""Scores of goals: relations between objects, the published score and the strict score."""
