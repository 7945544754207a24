"""The measured box with its seen sides where their surfaces were measured."""

import numpy as np

from grs_agents.geometry import to_vec3
from grs_agents.perception.proxies import box_mesh
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array

CONFIG = DEFAULT.box_fit


def mesh_fitted_box(seen: Observation, size: tuple[float, float, float]) -> tuple[Array, Faces]:
    """The mesh of the box of a measured size, each side that is seen moved to the median of its points. The measured
    box reaches to the outermost of them, which noise moves out; a side that is not seen stays."""
    low, high = np.array((-size[0] / 2, -size[1] / 2, 0.0)), np.array((size[0] / 2, size[1] / 2, size[2]))
    for axis in range(3):
        for towards, corner, opposite in ((-1, low, high), (1, high, low)):
            on = towards * seen.normals[:, axis] > CONFIG.facing
            if np.count_nonzero(on) < CONFIG.fewest:
                continue
            place = float(np.median(seen.points[on, axis]))
            if towards * (place - opposite[axis]) > CONFIG.thinnest:
                corner[axis] = place
    return box_mesh(to_vec3(high - low), to_vec3((low + high) / 2))
