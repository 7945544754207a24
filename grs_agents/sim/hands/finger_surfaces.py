"""Surfaces of a hand's parts as points: the inner faces of two fingers, and boxes around what is behind them."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.two_fingers import Block

_SKEW: Final = np.cos(np.deg2rad(15))
"""Cosine of the angle up to which a direction counts as an axis of the carrier."""
PAD_HEIGHT: Final = 0.025
"""Greatest height of the region at the end of a finger that is taken for its pad, metres."""
FACE: Final = 0.003
"""Depth within which points belong to the inner face of a pad, metres."""
_CELL: Final = 0.001
"""Edge of the cubes of which each keeps a single point of a surface, metres."""
_SLABS: Final = 4
GREY: Final = (0.45, 0.46, 0.48, 1.0)


class Fingers:
    """Points (N, 3) of both fingers in a state, axes of the hand: ``left`` at greater y."""

    def __init__(
        self,
        axes: FloatArray,
        left: FloatArray,
        right: FloatArray,
        state: FloatArray | None = None,
        bodies: Sequence[set[int]] = (),
    ) -> None:
        self.axes, self.left, self.right, self.state, self.bodies = axes, left, right, state, bodies
        self.end = min(float(left[:, 2].max()), float(right[:, 2].max()))
        ends: list[FloatArray] = []
        for side in (left, right):
            away = np.abs(side[:, 2] - self.end + PAD_HEIGHT / 2)
            ends.append(side[away <= max(PAD_HEIGHT / 2, float(away.min())) + 1e-6])  # the nearest of a long finger
        inner = float(ends[0][:, 1].min()), float(ends[1][:, 1].max())
        self.inner, self.gap = (inner[1], inner[0]), inner[0] - inner[1]
        faces = [side[np.abs(side[:, 1] - face) < FACE] for side, face in zip(ends, inner, strict=True)]
        low = max(float(face[:, 0].min()) for face in faces)
        high = min(float(face[:, 0].max()) for face in faces)
        self.middle = (low + high) / 2, (inner[0] + inner[1]) / 2
        deep = max(float(face[:, 2].min()) for face in faces)
        self.pad = (
            float(np.clip((high - low) / 2, 0.004, 0.02)),
            float(np.clip((self.end - deep) / 2, 0.004, PAD_HEIGHT / 2)),
        )


def snap_to_axis(direction: FloatArray, skew: float = _SKEW) -> FloatArray:
    """The nearest axis of the frame, if the cosine of the angle to it is at least ``skew``."""
    nearest = int(np.abs(direction).argmax())
    if abs(float(direction[nearest])) < skew:
        return direction
    return np.sign(direction[nearest]) * np.eye(3)[nearest]


def bounding_boxes(
    points: FloatArray, low: float, high: float, inner: float | None = None, slabs: int = _SLABS
) -> Iterator[Block]:
    """Bounding boxes of points in slabs between two heights, metres; with ``inner`` from that y (m) outwards."""
    edges = np.linspace(low, high, slabs + 1)
    for start, end in pairwise(edges):
        near = points[(points[:, 2] >= start - 1e-4) & (points[:, 2] <= end + 1e-4)]
        if inner is not None:
            near = near[near[:, 1] > inner]
        if end - start < 1e-3 or len(near) < 3:
            continue
        lowest, highest = near[:, :2].min(axis=0), near[:, :2].max(axis=0)
        if inner is not None:
            lowest[1] = max(float(lowest[1]), inner)
        half = np.maximum((highest - lowest) / 2, 5e-4)
        x, y = ((highest + lowest) / 2).tolist()
        half_x, half_y = half.tolist()
        yield Block((x, y, float(start + end) / 2), (half_x, half_y, float(end - start) / 2), GREY)


def sample_surface(model: Any, geom: int) -> FloatArray:
    """Points (N, 3) on the surface of a mesh, or of the bounding box of a primitive, frame of the geom."""
    if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.array(model.mesh_vert[start : start + count], dtype=np.float64)
        start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        triangles = vertices[model.mesh_face[start : start + count]]
        wide = np.ptp(triangles, axis=1).max(axis=1) > FACE
        points = np.vstack([vertices, np.einsum("wk,tkd->twd", _barycentric_grid(3), triangles[wide]).reshape(-1, 3)])
        return points[np.unique(np.round(points / _CELL).astype(np.int32), axis=0, return_index=True)[1]]
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(middle + half * grid[np.abs(grid).max(axis=1) == 1.0], dtype=np.float64)


def _barycentric_grid(steps: int) -> npt.NDArray[np.float64]:
    rows = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    return np.array(rows, dtype=np.float64) / steps
