"""Pictures by rays in the light that OpenGL draws with: on every machine, as near to its colours as is cheap.

What never moves is worked out once for each place of the camera; rays are cast only through the pixels at which there
may be something else.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.asset_rendering import Lens
from grs_agents.sim.rendering.lighting import Lighting
from grs_agents.sim.rendering.rays import RayCaster
from grs_agents.sim.rendering.scenery import Backdrop, Scenery
from grs_agents.sim.rendering.stage import ARM_GROUP, TABLE_GROUP, Stage
from grs_agents.sim.rendering.surface_colors import SurfaceColors

Floats = npt.NDArray[np.float32]
_CORNERS: Final = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_EDGES: Final = np.array([(a, b) for a in range(8) for b in (a | 1, a | 2, a | 4) if b != a])
"""Corners of a box and those that its edges join."""
_NEAR: Final = 0.01
"""What is nearer to the camera is not looked for, m."""
_MOST_PARTS: Final = 6
"""Of a long thing, each looked for in a box of its own."""


class RayPainter:
    """Draws a stage in pictures of one size."""

    def __init__(self, stage: Stage, height: int, width: int) -> None:
        self._stage, self._shape, self._caster = stage, (height, width), RayCaster(height * width)
        self._boxes = _BoxesOfGeoms(stage)
        self._paint: Floats = np.asarray(stage.model.geom_rgba[:, :3] * 255, np.float32)
        self._lighting = Lighting(stage)
        self._scenery, self._backdrop = Scenery(stage, self._lighting), None
        self._surfaces: SurfaceColors | None = None

    def prepare_view(self, lens: Lens, pose: FloatArray, arm: bool = True) -> None:
        """Take up how the stage is now, seen through ``lens`` from ``pose`` (T_robot_cam, OpenCV axes)."""
        behind: Backdrop | None = self._backdrop
        if behind is None or behind.lens != lens or not np.array_equal(behind.pose, pose):
            behind = self._backdrop = self._scenery.draw_backdrop(lens, pose)
        rows = np.flatnonzero(self._boxes.project_to_picture_mask(lens, pose, arm))
        directions = behind.directions[:, rows].T.astype(np.float64, order="C")
        hits = self._caster.cast(self._stage, pose[:3, 3], directions, table=False, arm=arm)
        nearer = np.flatnonzero((hits.geom >= 0) & (hits.depth < behind.depth[rows]))
        self._behind, self._rows = behind, rows[nearer]
        self._geoms, self._depth = hits.geom[nearer], hits.depth[nearer].astype(np.float32)
        self._normals = hits.normal[nearer].T.astype(np.float32)

    def draw_color(self) -> npt.NDArray[np.uint8]:
        """(H, W, 3) as seen from where ``look`` was told."""
        behind, rows, normals = self._behind, self._rows, self._normals
        directions = behind.directions[:, rows]
        points = directions * self._depth + behind.pose[:3, 3:].astype(np.float32)
        facing = np.einsum("ij,ij->j", normals, directions) / -behind.lengths[rows]
        light = self._lighting.compute_light_at_points(points, normals * np.sign(facing), np.abs(facing))
        color = behind.color.copy()
        color[rows] = self._compute_lit_colors(points, light)
        return color.reshape(*self._shape, 3)

    def draw_depth_and_owner(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """(H, W) each: metres along the optical axis, 0 for nothing; object id or -1."""
        far = self._behind.depth
        depth, owner = np.where(np.isfinite(far), far, np.float32(0)), np.full(len(far), -1, np.int32)
        depth[self._rows], owner[self._rows] = self._depth, self._stage.owners[self._geoms]
        return depth.reshape(self._shape), owner.reshape(self._shape)

    @property
    def is_usable(self) -> bool:
        """Rays may be cast in any process."""
        return True

    def close(self) -> None:
        """Rays hold nothing."""

    def _compute_lit_colors(self, points: Floats, light: Floats) -> Floats:
        """(N, 3) colours, 0..255, of what was met at ``points`` (3, N), m, in ``light`` (N, 3)."""
        stage, geoms = self._stage, self._geoms
        if self._surfaces is None:
            self._surfaces = SurfaceColors(stage.textured, stage.library, stage.model.ngeom)
        color = self._paint[geoms] * light
        rows = np.flatnonzero(self._surfaces.shown[geoms])
        if rows.size:
            data, bodies = stage.data, stage.model.geom_bodyid[geoms[rows]]
            offsets, turns = points[:, rows].T - data.xpos[bodies], data.xmat[bodies].reshape(-1, 3, 3)
            own = self._surfaces.sample_colors_at_points(geoms[rows], np.einsum("ij,ijk->ik", offsets, turns))
            color[rows] = own * np.minimum(light[rows], 1)  # OpenGL, too, bounds the light before it looks a color up
        return np.minimum(color, 255)


class _BoxesOfGeoms:
    """Boxes around all that can move, long things cut into parts."""

    def __init__(self, stage: Stage) -> None:
        self._stage, model = stage, stage.model
        geoms = np.flatnonzero((model.geom_group != TABLE_GROUP) & (model.geom_rgba[:, 3] > 0))
        middles, halves, owners = list[FloatArray](), list[FloatArray](), list[int]()
        for geom in geoms.tolist():
            middle, half = model.geom_aabb[geom, :3].copy(), model.geom_aabb[geom, 3:].copy()
            axis = int(np.argmax(half))
            parts = int(np.clip(np.ceil(half[axis] / max(np.sort(half)[1], 1e-6)), 1, _MOST_PARTS))
            along = np.eye(3)[axis] * half[axis]
            half[axis] /= parts
            for part in range(parts):
                middles.append(middle + along * ((2 * part + 1) / parts - 1))
                halves.append(half)
                owners.append(geom)
        self._geoms = np.array(owners, np.int64)
        self._corners = np.reshape(middles, (-1, 1, 3)) + np.reshape(halves, (-1, 1, 3)) * _CORNERS
        self._is_arm = model.geom_group[self._geoms] == ARM_GROUP

    def project_to_picture_mask(self, lens: Lens, pose: FloatArray, arm: bool) -> npt.NDArray[np.bool_]:
        """(H * W,) the pixels that the boxes cover; not those of the robot's without ``arm``."""
        shown, data = slice(None) if arm else ~self._is_arm, self._stage.data
        geoms = self._geoms[shown]
        turns = data.geom_xmat[geoms].reshape(-1, 3, 3)
        corners = self._corners[shown] @ turns.transpose(0, 2, 1) + data.geom_xpos[geoms][:, None]
        edges = _find_boxes_in_picture((corners - pose[:3, 3]) @ pose[:3, :3], lens)
        left, right, top, bottom = np.clip(edges, 0, max(lens.height, lens.width)).astype(np.int64).tolist()
        mask = np.zeros((lens.height, lens.width), bool)
        for first, last, high, low in zip(left, right, top, bottom, strict=True):
            mask[high:low, first:last] = True
        return mask.ravel()


def _find_boxes_in_picture(corners: FloatArray, lens: Lens) -> FloatArray:
    """(4, G) the first column and row that boxes cover, and those after the last: left, right, top, bottom.

    The corners (G, 8, 3) are in the camera's frame, m. What lies behind the camera is cut off; of a box that is all
    there, every number is -1.
    """
    first, second = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (_NEAR - first[..., 2:]) / (second[..., 2:] - first[..., 2:])
        cut = np.where((share > 0) & (share < 1), first + share * (second - first), np.nan)
        points = np.concatenate([np.where(corners[..., 2:] >= _NEAR, corners, np.nan), cut], axis=1)
        x, y, z = np.moveaxis(points, -1, 0)
        across, down = x / z * lens.fx + lens.cx, y / z * lens.fy + lens.cy
    lows = np.floor([np.fmin.reduce(across, axis=1), np.fmin.reduce(down, axis=1)])
    highs = np.ceil([np.fmax.reduce(across, axis=1), np.fmax.reduce(down, axis=1)]) + 1
    return np.nan_to_num(np.stack([lows[0], highs[0], lows[1], highs[1]]), nan=-1.0)
