"""What runs outside the sandbox: it starts workers, hands out work and reads what comes back."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
