"""Read a scene from a folder, a data set, an archive or a photo; what is wrong with it is refused by InputError."""

from grs_agents.doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
