"""The background of a photo as a fixed asset of the run: a visual mesh and colliding boxes."""

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_text
from grs_agents.library.asset import DEFAULT_FRICTION
from grs_agents.library.formats.model_file import MAX_SHAPES
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.mesh_files import format_obj_text
from grs_agents.library.shapes import Shape

BACKGROUND: Final = "background/room.urdf"
"""Its name in the library of the run. No manifest lists it, so no task is offered it."""
_MESH: Final = "background/room.obj"


def write_background_asset(
    root: Path,
    vertices: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int64],
    boxes: npt.NDArray[np.float64],
    color: Vec3,
) -> str:
    """Write ``root/background/room.urdf`` and its mesh; returns the asset's name. Its frame is the robot's.

    Args:
        root: the library folder to write into.
        vertices: (V, 3) of the visual mesh, metres.
        faces: (F, 3) indices of them, counterclockwise from outside.
        boxes: (B, 2, 3) lowest and highest corners of the colliders, metres.
        color: red, green, blue in 0..1.

    Raises:
        InputError: there is too little or too much of it, or the folder cannot be written.
    """
    if len(vertices) < 4 or not 0 < len(boxes) <= MAX_SHAPES:
        remedy = f"give at least 4 vertices and 1 to {MAX_SHAPES} boxes"
        raise InputError(f"a background of {len(vertices)} vertices and {len(boxes)} boxes", remedy)
    red, green, blue = color
    seen = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=_MESH, color=(red, green, blue, 1.0))
    solids: list[Shape] = []
    for low, high in boxes:
        (x, y, z), (a, b, c) = (low + high) / 2, high - low
        box = Shape(kind="box", size=(float(a), float(b), float(c)), position=(float(x), float(y), float(z)))
        solids.append(box)
    write_text(root / _MESH, format_obj_text(vertices, faces))
    friction = DEFAULT_FRICTION.value
    urdf = format_urdf_text("room", [seen], solids, mass=0.0, friction=friction, folder="background")
    write_text(root / BACKGROUND, urdf)
    return BACKGROUND
