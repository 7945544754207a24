"""Depth comes with the photo; a photo without it is refused. The default."""

from dataclasses import dataclass
from typing import NoReturn

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.photo_without_depth import DepthEstimate
from grs_agents.perception.types import Image
from grs_agents.toolkit import ToolContext

Result = DepthEstimate


@dataclass(frozen=True)
class Request:
    """A photo without depth.

    Attributes:
        rgb: (H, W, 3) uint8.
        focal: its focal length in pixels, if known.
        photo: its name in errors.
        model: ``depth.model`` of the configuration.
    """

    rgb: Image
    focal: float | None
    photo: str
    model: str | None


def run(request: Request, context: ToolContext) -> NoReturn:
    """Refuse.

    Raises:
        InputError: always: the tool is only called for a photo without depth.
    """
    raise InputError(
        f"{request.photo} has no depth",
        "name a folder with it, depth.png or a point cloud, and camera.json; or have a model of your own estimate it: "
        "--set tools.depth=depth_transformers --set depth.model=FOLDER",
    )
