"""Planted faults: right programs and tests for the sample scene, and the mistakes that are made in them."""
