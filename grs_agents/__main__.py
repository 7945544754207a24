"""``python -m grs_agents`` is ``grs``."""

from grs_agents.cli.entry import main

main()
