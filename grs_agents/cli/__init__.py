"""The ``grs`` command."""
