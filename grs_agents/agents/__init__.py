"""The agents: describer, matcher, task author, simulation author, test author, router and the two fixers."""
