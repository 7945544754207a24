"""A mesh as the photo's camera sees it, and how far that is from the photo."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array


def draw_depth(seen: Observation, vertices: Array, faces: Faces) -> npt.NDArray[np.float64]:
    """(h, w) depth of a mesh in the observation's window, 0 where it is not seen."""
    column, row, depth = seen.project(vertices)
    nearness = 1 / np.maximum(depth, 1e-3)
    corners = np.stack([column, row], axis=1)[faces]
    height, width = seen.mask.shape
    buffer = rasterise_triangles(corners, nearness[faces], width, height)
    return np.where(buffer.triangle >= 0, 1 / np.where(buffer.triangle >= 0, buffer.nearness, 1), 0.0)


@dataclass(frozen=True)
class Agreement:
    """How well a mesh agrees with the view."""

    overlap: float  # intersection over union of silhouette and mask, where nothing nearer hides the mesh
    raw_error: float  # 90th percentile of |mesh - measured| over the mask's measured pixels that it covers, m
    error: float  # the same of the smoothed depth away from the mask's edge, where pixels do not mix two surfaces
    near: float  # share of those pixels where the mesh is within `ShapeChoice.explained_within` of the depth
    close: float  # and within `ShapeChoice.explained_closely`


def compare_mesh_with_photo(seen: Observation, vertices: Array, faces: Faces) -> Agreement:
    """Draw a mesh from the photo's camera and compare."""
    drawn = draw_depth(seen, vertices, faces)
    shown, known = drawn > 0, seen.measured > 0
    hidden = ~seen.mask & known & shown & (seen.measured < drawn - DEFAULT.observation.nearer)
    union = ((shown & ~hidden) | seen.mask).sum()
    both = shown & seen.mask
    raw = np.abs(drawn - seen.measured)[both & known]
    inner = np.abs(drawn - seen.depth)[both & known & (seen.edge < -DEFAULT.choice.inset)]
    within = max(DEFAULT.choice.explained_within, 3 * seen.noise)
    closely = np.clip(2 * seen.noise, DEFAULT.choice.explained_closely, DEFAULT.choice.explained_within)
    return Agreement(
        float(both.sum() / max(union, 1)),
        float(np.percentile(raw, 90)) if len(raw) else np.inf,
        float(np.percentile(inner, 90)) if len(inner) else np.inf,
        float((inner < within).mean()) if len(inner) else 0.0,
        float((inner < closely).mean()) if len(inner) else 0.0,
    )
