"""Ray-cast images with the lighting model of MuJoCo's OpenGL renderer, without OpenGL: the same on every machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.asset_rendering import Lens, PaintedTriangles, build_textured_triangles, sample_triangle_colors
from grs_agents.library.library import Library
from grs_agents.library.shapes import Shape
from grs_agents.sim.rendering.cameras import lens_ray_directions
from grs_agents.sim.rendering.stage import ARM_GROUP, SKY, TABLE_GROUP, Stage
from grs_agents.sim.world.appearance import read_table_pattern

Floats = npt.NDArray[np.float32]
_FARTHEST: Final = 1e10


@dataclass(frozen=True)
class Hits:
    """Intersections of N rays with a stage; the arrays are overwritten by the next cast of the same ``RayCaster``."""

    geom: npt.NDArray[np.int32]  # (N,) geom id, -1 without a hit
    depth: FloatArray  # (N,) in multiples of the ray's length: metres along the optical axis for camera rays
    normal: FloatArray  # (N, 3) surface normal, unit length


class RayCaster:
    """Casts up to ``most`` rays at a time, into buffers that are allocated once."""

    def __init__(self, most: int) -> None:
        self._geom, self._depth, self._normal = np.empty(most, np.int32), np.empty(most), np.empty(3 * most)

    def cast(self, stage: Stage, eye: FloatArray, directions: FloatArray, table: bool = True, arm: bool = True) -> Hits:
        """Hits of rays (N, 3) from ``eye`` (3,), m; rays pass through the table and the robot unless asked for."""
        count = len(directions)
        groups: npt.NDArray[Any] = np.array([table, arm, 1, 0, 0, 0], np.uint8)
        geom, depth, normal = self._geom[:count], self._depth[:count], self._normal[: 3 * count]
        flat = np.ascontiguousarray(directions, np.float64).ravel()
        mujoco.mj_multiRay(stage.model, stage.data, eye, flat, groups, 1, -1, geom, depth, normal, count, _FARTHEST)
        return Hits(geom, depth, normal.reshape(-1, 3))


_SPOT: Final = float(np.cos(np.deg2rad(45.0)))
"""Cosine of the lamp's cutoff angle."""


class Lighting:
    """Lighting of a stage as OpenGL computes it: ambient, headlight and a lamp, without shadows and highlights."""

    def __init__(self, stage: Stage) -> None:
        head: Any = stage.model.vis.headlight
        self._lamp: Floats = stage.data.light_xpos[0].astype(np.float32)[:, None]
        self._axis: Floats = stage.data.light_xdir[0].astype(np.float32)
        colors = [head.ambient, head.diffuse, stage.model.light_diffuse[0]]
        self._colors: Floats = np.asarray(colors, np.float32)

    def compute_light_at_points(self, points: Floats, normals: Floats, facing: Floats) -> Floats:
        """Light (N, 3) in red, green and blue at surface points; 1 shows a surface in its own colour.

        Args:
            points: (3, N) m.
            normals: (3, N) surface normals, or (3, 1), unit length, towards the camera.
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


@dataclass(frozen=True)
class Backdrop:
    """Image of table and sky through a lens, and the rays of its N pixels."""

    lens: Lens
    pose: FloatArray  # T_robot_cam (4, 4)
    directions: Floats  # (3, N), of length 1 along the optical axis
    lengths: Floats  # (N,)
    depth: Floats  # (N,) m, infinite beside the table
    color: npt.NDArray[np.uint8]  # (N, 3)


class BackdropPainter:
    """Draws the static part of a stage: table and sky."""

    def __init__(self, stage: Stage, lighting: Lighting) -> None:
        table = stage.model.geom("table")
        self._place: Floats = np.asarray(table.pos, np.float32)
        self._half: Floats = np.asarray(table.size, np.float32)
        self._paint: Floats = np.asarray(table.rgba[:3] * 255, np.float32)
        self._pattern, self._lighting = read_table_pattern(stage.model), lighting
        self._rays: tuple[Lens, Floats, Floats] | None = None  # directions (3, N) in the camera frame, lengths (N,)

    def draw_backdrop(self, lens: Lens, pose: FloatArray) -> Backdrop:
        """Table and sky through ``lens`` from ``pose`` (T_robot_cam)."""
        if self._rays is None or self._rays[0] != lens:
            local = np.ascontiguousarray(lens_ray_directions(lens).reshape(-1, 3).T, np.float32)
            self._rays = lens, local, np.sqrt(np.einsum("ij,ij->j", local, local))
        _, local, lengths = self._rays
        directions, eye = pose[:3, :3].astype(np.float32) @ local, pose[:3, 3].astype(np.float32)
        depth, color = np.full(len(lengths), np.inf, np.float32), np.empty((len(lengths), 3), np.uint8)
        for axis in range(3):  # the visible faces of the table
            side = float(np.sign(eye[axis] - self._place[axis]))
            ahead = self._place[axis] + side * self._half[axis] - eye[axis]
            if ahead * side >= 0:  # back face
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = ahead / directions[axis]
                hit = reach > 0
                for across in {0, 1, 2} - {axis}:
                    hit &= np.abs(directions[across] * reach + (eye - self._place)[across]) <= self._half[across]
            rows = slice(None) if hit.all() else np.flatnonzero(hit)
            color[rows] = self._color_of_face(eye, directions[:, rows], lengths[rows], reach[rows], axis, side)
            depth[rows] = reach[rows]
        sky = np.flatnonzero(np.isinf(depth))
        above, below = np.array(SKY, np.float32) * 255
        color[sky] = below + ((1 + directions[2, sky] / lengths[sky]) / 2)[:, None] * (above - below)
        return Backdrop(lens, pose.copy(), directions, lengths, depth, color)

    def _color_of_face(
        self, eye: Floats, directions: Floats, lengths: Floats, reach: Floats, axis: int, side: float
    ) -> Floats:
        points, normal = directions * reach + eye[:, None], np.zeros((3, 1), np.float32)
        normal[axis] = side
        light = self._lighting.compute_light_at_points(points, normal, directions[axis] * np.float32(-side) / lengths)
        if self._pattern is None:
            return np.minimum(light * self._paint, 255)
        pixels, period = self._pattern
        across = (points[0] - (self._place[0] - self._half[0])) / np.float32(period)
        down = ((self._place[1] + self._half[1]) - points[1]) / np.float32(period)
        last = len(pixels) - 1
        rows = np.minimum((down % 1 * len(pixels)).astype(np.int64), last)
        columns = np.minimum((across % 1 * len(pixels)).astype(np.int64), last)
        texels = pixels[rows, columns].astype(np.float32)
        return np.minimum(light, 1) * texels  # clamp before the texture lookup, as OpenGL does


_CELLS: Final = 48
"""Voxels along the longest side of a shape."""
_SAMPLES: Final = 2.0
"""Surface samples along the side of a voxel."""
_MOST_SAMPLES: Final = 400_000
_remembered: WeakKeyDictionary[Library, dict[Shape, "ColorGrid"]] = WeakKeyDictionary()


class ColorGrid:
    """Mean colours of a textured surface in voxels.

    Attributes:
        low: (3,) lowest corner of the first voxel, m.
        cell: side of a voxel, m.
        colors: (X, Y, Z, 3) red, green, blue, 0..255.
    """

    def __init__(self, painted: PaintedTriangles) -> None:
        corners = painted.corners
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.cell = max(float((high - low).max()) / _CELLS, 1e-6)
        self.low = low - self.cell / 2  # keeps the lowest faces off the border between two layers
        count: npt.NDArray[np.int64] = np.floor((high - self.low) / self.cell).astype(np.int64) + 1
        triangle, weights = _sample_surface(corners, self.cell / _SAMPLES)
        samples = sample_triangle_colors(painted, triangle, weights) * 255
        cells = ((np.einsum("ij,ijk->ik", weights, corners[triangle]) - self.low) / self.cell).astype(np.int64)
        flat = np.ravel_multi_index(tuple(np.clip(cells, 0, count - 1).T), tuple(count))
        hits = np.bincount(flat, minlength=int(count.prod()))
        sums = [np.bincount(flat, samples[:, channel], int(count.prod())) for channel in range(3)]
        colors = np.stack(sums, axis=-1) / np.maximum(hits, 1)[:, None]
        colors[hits == 0] = samples.mean(axis=0)
        self.colors: Floats = colors.astype(np.float32).reshape(*count, 3)


def _sample_surface(
    corners: npt.NDArray[np.float64], spacing: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Triangle indices (S,) and barycentric weights (S, 3) of samples ``spacing`` m apart, corners included."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(sides / spacing).astype(np.int64) + 1
    if (total := float((steps.astype(np.float64) ** 2).sum())) > _MOST_SAMPLES:
        steps = np.maximum((steps * np.sqrt(_MOST_SAMPLES / total)).astype(np.int64), 1)
    triangles: list[npt.NDArray[np.int64]] = []
    weights: list[npt.NDArray[np.float64]] = []
    for count in np.unique(steps):
        first, second = np.indices((count + 1, count + 1)).reshape(2, -1)
        inside = first + second <= count
        grid = np.stack([first, second, count - first - second], axis=1)[inside] / count
        mine = np.flatnonzero(steps == count)
        triangles.append(np.repeat(mine, len(grid)))
        weights.append(np.tile(grid, (len(mine), 1)))
    return np.concatenate(triangles), np.concatenate(weights)


class SurfaceColors:
    """Colours of textured shapes, by geom id."""

    def __init__(self, textured: Mapping[int, Shape], library: Library, geoms: int) -> None:
        known = _remembered.setdefault(library, {})
        self.shown = np.zeros(geoms, bool)
        self._start, self._count = np.zeros(geoms, np.int64), np.ones((geoms, 3), np.int64)
        self._low, self._scale = np.zeros((geoms, 3)), np.ones((geoms, 1))
        cells, total = [np.zeros((1, 3), np.float32)], 1
        for geom, shape in textured.items():
            if shape not in known:
                plain = shape.model_copy(update={"color": None})  # OpenGL shows the texture alone
                known[shape] = ColorGrid(build_textured_triangles(library, [plain]))
            grid = known[shape]
            self.shown[geom], self._start[geom], self._count[geom] = True, total, grid.colors.shape[:3]
            self._low[geom], self._scale[geom] = grid.low, 1 / grid.cell
            cells.append(grid.colors.reshape(-1, 3))
            total += len(cells[-1])
        self._cells: Floats = np.concatenate(cells)

    def sample_colors_at_points(self, geoms: npt.NDArray[np.int32], points: npt.NDArray[np.float64]) -> Floats:
        """Colours (N, 3), 0..255, at points (N, 3) in the frames of the geoms' bodies, m."""
        count = self._count[geoms]
        x, y, z = np.clip(((points - self._low[geoms]) * self._scale[geoms]).astype(np.int64), 0, count - 1).T
        return self._cells[self._start[geoms] + (x * count[:, 1] + y) * count[:, 2] + z]


_CORNERS: Final = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_EDGES: Final = np.array([(a, b) for a in range(8) for b in (a | 1, a | 2, a | 4) if b != a])
"""Corners of a box, and the pairs of corners that its edges join."""
_NEAR: Final = 0.01
"""Near clipping plane, m."""
_MOST_PARTS: Final = 6
"""Boxes that a long geom is split into, at most."""


class RayPainter:
    """Draws a stage in images of a fixed size, in colours close to OpenGL's.

    Table and sky are drawn once for each camera pose; rays are cast only through pixels that other geoms may cover.
    """

    def __init__(self, stage: Stage, height: int, width: int) -> None:
        self._stage, self._shape, self._caster = stage, (height, width), RayCaster(height * width)
        self._boxes = _BoxesOfGeoms(stage)
        self._paint: Floats = np.asarray(stage.model.geom_rgba[:, :3] * 255, np.float32)
        self._lighting = Lighting(stage)
        self._backdrops, self._backdrop = BackdropPainter(stage, self._lighting), None
        self._surfaces: SurfaceColors | None = None

    def prepare_view(self, lens: Lens, pose: FloatArray, arm: bool = True) -> None:
        """Capture the current state of the stage through ``lens`` from ``pose`` (T_robot_cam, OpenCV axes)."""
        behind: Backdrop | None = self._backdrop
        if behind is None or behind.lens != lens or not np.array_equal(behind.pose, pose):
            behind = self._backdrop = self._backdrops.draw_backdrop(lens, pose)
        rows = np.flatnonzero(self._boxes.cover_mask(lens, pose, arm))
        directions = behind.directions[:, rows].T.astype(np.float64, order="C")
        hits = self._caster.cast(self._stage, pose[:3, 3], directions, table=False, arm=arm)
        nearer = np.flatnonzero((hits.geom >= 0) & (hits.depth < behind.depth[rows]))
        self._behind, self._rows = behind, rows[nearer]
        self._geoms, self._depth = hits.geom[nearer], hits.depth[nearer].astype(np.float32)
        self._normals = hits.normal[nearer].T.astype(np.float32)

    def draw_color(self) -> npt.NDArray[np.uint8]:
        """Colour image (H, W, 3) of the prepared view."""
        behind, rows, normals = self._behind, self._rows, self._normals
        stage, geoms = self._stage, self._geoms
        directions = behind.directions[:, rows]
        points = directions * self._depth + behind.pose[:3, 3:].astype(np.float32)
        facing = np.einsum("ij,ij->j", normals, directions) / -behind.lengths[rows]
        light = self._lighting.compute_light_at_points(points, normals * np.sign(facing), np.abs(facing))
        if self._surfaces is None:
            self._surfaces = SurfaceColors(stage.textured, stage.library, stage.model.ngeom)
        lit = self._paint[geoms] * light
        textured = np.flatnonzero(self._surfaces.shown[geoms])
        if textured.size:
            data, bodies = stage.data, stage.model.geom_bodyid[geoms[textured]]
            offsets, turns = points[:, textured].T - data.xpos[bodies], data.xmat[bodies].reshape(-1, 3, 3)
            local = np.einsum("ij,ijk->ik", offsets, turns)
            texels = self._surfaces.sample_colors_at_points(geoms[textured], local)
            lit[textured] = texels * np.minimum(light[textured], 1)  # clamp before the texture lookup, as OpenGL does
        color = behind.color.copy()
        color[rows] = np.minimum(lit, 255)
        return color.reshape(*self._shape, 3)

    def draw_depth_and_owner(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Depth (H, W), m along the optical axis, 0 without a hit, and owner (H, W), object id or -1."""
        far = self._behind.depth
        depth, owner = np.where(np.isfinite(far), far, np.float32(0)), np.full(len(far), -1, np.int32)
        depth[self._rows], owner[self._rows] = self._depth, self._stage.owners[self._geoms]
        return depth.reshape(self._shape), owner.reshape(self._shape)

    @property
    def is_usable(self) -> bool:
        """Always: ray casting works in any process."""
        return True

    def close(self) -> None:
        """Nothing to release."""


class _BoxesOfGeoms:
    """Bounding boxes of all movable geoms, long geoms split along their longest axis."""

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

    def cover_mask(self, lens: Lens, pose: FloatArray, arm: bool) -> npt.NDArray[np.bool_]:
        """Mask (H * W,) of the pixels that the boxes cover; without ``arm``, the robot's boxes are left out."""
        shown, data = slice(None) if arm else ~self._is_arm, self._stage.data
        geoms = self._geoms[shown]
        turns = data.geom_xmat[geoms].reshape(-1, 3, 3)
        corners = self._corners[shown] @ turns.transpose(0, 2, 1) + data.geom_xpos[geoms][:, None]
        edges = _project_boxes((corners - pose[:3, 3]) @ pose[:3, :3], lens)
        left, right, top, bottom = np.clip(edges, 0, max(lens.height, lens.width)).astype(np.int64).tolist()
        mask = np.zeros((lens.height, lens.width), bool)
        for first, last, high, low in zip(left, right, top, bottom, strict=True):
            mask[high:low, first:last] = True
        return mask.ravel()


def _project_boxes(corners: FloatArray, lens: Lens) -> FloatArray:
    """Pixel bounds (4, G) of boxes, half open: left, right, top, bottom.

    ``corners`` (G, 8, 3) are in the camera frame, m. Boxes are clipped at the near plane; those wholly behind it have
    the bounds -1.
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
