"""Code that draws the shipped assets: run ``python -m scripts.assets`` to write them again."""
