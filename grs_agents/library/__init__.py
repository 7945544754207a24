"""The 3D asset library: what an object is, what its URDF says, and where its files lie."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
