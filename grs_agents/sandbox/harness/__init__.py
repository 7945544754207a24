"""What runs inside the sandbox: the zygote, its children, and the tests of a program."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
