"""The light of a stage, as OpenGL reckons it: from everywhere, from the camera, and from one lamp. There is no shadow
and no gloss."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.rendering.stage import Stage

Floats = npt.NDArray[np.float32]
_SPOT: Final = float(np.cos(np.deg2rad(45.0)))
"""Cosine of the angle from its axis beyond which a lamp does not shine."""


class Lighting:
    """The light of one stage."""

    def __init__(self, stage: Stage) -> None:
        head: Any = stage.model.vis.headlight
        self._lamp: Floats = stage.data.light_xpos[0].astype(np.float32)[:, None]
        self._axis: Floats = stage.data.light_xdir[0].astype(np.float32)
        colors = [head.ambient, head.diffuse, stage.model.light_diffuse[0]]
        self._colors: Floats = np.asarray(colors, np.float32)

    def compute_light_at_points(self, points: Floats, normals: Floats, facing: Floats) -> Floats:
        """(N, 3) red, green, blue of the light, 1 shows a thing in its own colour.

        Args:
            points: (3, N) m.
            normals: (3, N) of the surface, or (3, 1), unit length, on the camera's side.
            facing: (N,) cosine of the angle between the normal and the direction to the camera.
        """
        towards = self._lamp - points
        nearness = 1 / np.sqrt(np.einsum("ij,ij->j", towards, towards))
        along = (self._axis @ towards) * -nearness
        square = along * along
        fading = np.where(along > _SPOT, square * square * square * square * square, np.float32(0))
        slope = (normals[0] * towards[0] + normals[1] * towards[1] + normals[2] * towards[2]) * nearness
        parts = np.empty((len(facing), 3), np.float32)
        parts[:, 0], parts[:, 1], parts[:, 2] = 1, facing, np.maximum(slope, 0) * fading
        return parts @ self._colors
