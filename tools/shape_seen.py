"""Reconstruct an object's shape from the photo: box, round, mirrored, or carved. No weights. The default."""

from dataclasses import dataclass
from pathlib import Path

from grs_agents.perception.shapes.mesh_file import MeshFile
from grs_agents.perception.shapes.reconstruction import reconstruct_shape
from grs_agents.perception.shapes.types import ObjectShape, ObjectView
from grs_agents.toolkit import ToolContext


@dataclass(frozen=True)
class Request:
    """An object that no asset matches.

    Attributes:
        view: the photo, depth, the object's pixels, camera, frame and measured size.
        folder: for files of the tool; this tool writes none.
        model: ``shape.model`` of the configuration.
    """

    view: ObjectView
    folder: Path
    model: str | None = None


@dataclass(frozen=True)
class Result:
    """The shape, or a mesh file to be scaled and registered to the measured points.

    ``None`` with too little measured depth: a primitive of the measured size replaces it.
    """

    shape: ObjectShape | MeshFile | None


def run(request: Request, context: ToolContext) -> Result:
    """Reconstruct."""
    return Result(reconstruct_shape(request.view))
