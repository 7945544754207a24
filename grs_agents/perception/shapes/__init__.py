"""Shapes of objects that no asset matches: a closed, textured mesh reconstructed from the photo, and its colliders."""

from grs_agents.perception.shapes.mesh_file import MeshFile as MeshFile
from grs_agents.perception.shapes.types import ObjectShape as ObjectShape
from grs_agents.perception.shapes.types import ObjectView as ObjectView
