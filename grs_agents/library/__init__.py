"""The 3D asset library: objects, the contents of their URDFs, and the places of their files."""

from grs_agents.library.library import Library as Library
