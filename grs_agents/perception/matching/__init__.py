"""Matching of segments with assets, by features, by CLIP or by a model."""
