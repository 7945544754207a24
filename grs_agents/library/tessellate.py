"""Triangles of boxes, cylinders and spheres."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from grs_agents.library.mesh_surface import Surface
from grs_agents.library.shapes import Shape

Floats = npt.NDArray[np.float64]
_SECTIONS, _RINGS = 48, 24
_BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of each side, counter-clockwise from outside; corner number 4x + 2y + z of the unit cube."""


def solid_surface(shape: Shape) -> Surface:
    """The triangles of a primitive in its own frame (m), without texture coordinates."""
    if shape.kind == "box":
        cube = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        corners = _quads(cube * np.asarray(shape.size), _BOX)
    elif shape.kind == "cylinder":
        radius, length = shape.size
        corners = _turned([(0.0, -length / 2), (radius, -length / 2), (radius, length / 2), (0.0, length / 2)])
    else:
        angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        radius = shape.size[0]
        corners = _turned([(radius * float(np.cos(one)), radius * float(np.sin(one))) for one in angles])
    return Surface(corners, np.zeros((len(corners), 3, 2)))


def _turned(profile: Sequence[tuple[float, float]]) -> Floats:
    """The solid (T, 3, 3) that a profile of (radius, z), from the lowest point to the highest, makes around z."""
    angles = np.arange(_SECTIONS) * 2 * np.pi / _SECTIONS
    rings = [
        np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(_SECTIONS, z)], axis=1)
        for radius, z in profile
    ]
    quads = [
        (row * _SECTIONS + one, row * _SECTIONS + other, (row + 1) * _SECTIONS + other, (row + 1) * _SECTIONS + one)
        for row in range(len(profile) - 1)
        for one, other in ((number, (number + 1) % _SECTIONS) for number in range(_SECTIONS))
    ]
    return _quads(np.concatenate(rings), quads)


def _quads(vertices: Floats, quads: Sequence[tuple[int, int, int, int]]) -> Floats:
    """Two triangles for each quad; those without an area are left out."""
    triangles = np.array([three for a, b, c, d in quads for three in ((a, b, c), (a, c, d))])
    corners = vertices[triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return corners[areas > 1e-15]
