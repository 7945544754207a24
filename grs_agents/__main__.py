"""``python -m grs_agents`` is ``grs``."""

from grs_agents.cli import main

main()
