"""The 3D asset library: what an object is, what its URDF says, and where its files lie."""

from grs_agents.library.library import Library as Library
