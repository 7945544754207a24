"""Measurements of perception against ground truth."""
