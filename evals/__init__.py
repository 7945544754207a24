"""Experiments, one file each; what several share is in ``benchmark`` and ``synthesis``, which only a checkout has."""
