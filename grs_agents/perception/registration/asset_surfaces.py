"""Segments that are pieces of an object whose asset is known: their points lie on its surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.perception.configuration import DEFAULT, SurfaceExplanation
from grs_agents.perception.surfaces import Tree, surface_of
from grs_agents.perception.types import Array


@dataclass(frozen=True)
class AssetSurface:
    """The surface of an asset where it stands.

    Attributes:
        points: (N, 3) m, robot frame.
        normals: (N, 3) unit.
        spacing: about how far neighbours are apart, m.
    """

    points: Array
    normals: Array
    spacing: float

    def near(self, cloud: Array, reach: float) -> Array:
        """As `distances`, and infinite for points that are farther than ``reach`` m from the box around it."""
        low, high = self.points.min(axis=0) - reach, self.points.max(axis=0) + reach
        inside = np.flatnonzero(((cloud >= low) & (cloud <= high)).all(axis=1))
        found = np.full(len(cloud), np.inf)
        if len(inside):
            found[inside] = self.distances(cloud[inside])
        return found

    def distances(self, cloud: Array) -> Array:
        """How far (M, 3) points are from it, (M,) m: across it where they are before or behind it."""
        nearest, squares = Tree(self.points).nearest(cloud)
        across = np.abs(np.einsum("ni,ni->n", cloud - self.points[nearest], self.normals[nearest]))
        beside = np.sqrt(np.maximum(squares - across**2, 0)) > 2 * self.spacing
        return np.where(beside, np.sqrt(squares), across)


def asset_surface_at(asset: str, pose: Pose, library: Library) -> AssetSurface:
    """The surface of an asset whose bounding box has its centre (m) and rotation (xyzw) at ``pose``.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    surface, turn = surface_of(asset, library), rotation_matrix(pose[1])
    return AssetSurface(surface.points @ turn.T + pose[0], surface.normals @ turn.T, surface.spacing)


def surface_inliers(
    clouds: Sequence[Array],
    surfaces: Sequence[AssetSurface | None],
    config: SurfaceExplanation = DEFAULT.explanation,
) -> dict[int, int]:
    """Which objects are pieces of which, by index.

    Args:
        clouds: (N, 3) measured points of each object, m, robot frame.
        surfaces: the surface of each object's asset, where that is known.
        config: what is on a surface.
    """
    pieces: dict[int, int] = {}
    for piece, cloud in enumerate(clouds):
        for whole, surface in enumerate(surfaces):
            larger = whole != piece and len(clouds[whole]) > len(cloud) and whole not in pieces
            if surface is None or not larger or not len(cloud):
                continue
            if (surface.near(cloud, config.on) < config.on).mean() >= config.piece:
                pieces[piece] = whole
                break
    return pieces
