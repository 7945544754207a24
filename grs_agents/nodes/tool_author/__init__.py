"""Read a scene from a folder, a data set, an archive or a photo; what is wrong with it is refused by InputError."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
