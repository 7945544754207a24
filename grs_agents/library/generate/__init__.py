"""Code that draws the shipped assets: run ``python -m grs_agents.library.generate`` to write them again."""
