"""The workspace seen straight from above, as maps of one size a pixel."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.library import Library
from grs_agents.sim.instance.instance import InstanceObject
from grs_agents.sim.world import rendering

FloatArray = npt.NDArray[np.float64]
_FAR: Final = 100.0
"""Height of the eye, metres: so far that a thing 0.3 m high leans over by less than a pixel."""


def maps(
    objects: Sequence[InstanceObject], library: Library, bounds: FloatArray, pixel: float
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Colour (H, W, 3), height above the table (H, W; m), object id (H, W; 0 = none); rows along y, columns along x.

    Args:
        objects: what stands there; the arm is not seen.
        library: 3D assets.
        bounds: (3, 2) lowest and highest x, y, z.
        pixel: metres a pixel.
    """
    columns, rows = (round(float(extent) / pixel) for extent in bounds[:2, 1] - bounds[:2, 0])
    cells: FloatArray = np.indices((rows, columns)).astype(np.float64) + 0.5
    x, y = float(bounds[0, 0]) + cells[1] * pixel, float(bounds[1, 0]) + cells[0] * pixel
    eye = np.array([bounds[0].mean(), bounds[1].mean(), _FAR])
    directions = np.stack([x - eye[0], y - eye[1], np.full(x.shape, -_FAR)], axis=-1) / _FAR
    picture = rendering.cast(rendering.Sight(objects, library), eye, directions)
    height = np.where(picture.depth > 0, _FAR - picture.depth, 0)
    return picture.color, np.maximum(height, 0).astype(np.float32), np.maximum(picture.owner, 0)
