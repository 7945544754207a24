"""Experiments, a file each; shared code is in ``benchmark`` and ``synthesis``, which only a checkout has."""
