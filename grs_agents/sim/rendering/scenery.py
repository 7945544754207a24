"""What a camera sees of what never moves: the table and the sky."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.asset_rendering import Lens
from grs_agents.sim.rendering.lenses import lens_ray_directions
from grs_agents.sim.rendering.lighting import Lighting
from grs_agents.sim.rendering.stage import SKY, Stage
from grs_agents.sim.world.appearance import read_table_pattern

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Backdrop:
    """Table and sky through a lens from a pose, and the rays of its N pixels."""

    lens: Lens
    pose: FloatArray  # T_robot_cam (4, 4)
    directions: Floats  # (3, N), of length 1 along the optical axis
    lengths: Floats  # (N,)
    depth: Floats  # (N,) m, infinite where the table is not
    color: npt.NDArray[np.uint8]  # (N, 3)


class Scenery:
    """The table and the sky of a stage."""

    def __init__(self, stage: Stage, lighting: Lighting) -> None:
        table = stage.model.geom("table")
        self._place: Floats = np.asarray(table.pos, np.float32)
        self._half: Floats = np.asarray(table.size, np.float32)
        self._paint: Floats = np.asarray(table.rgba[:3] * 255, np.float32)
        self._pattern, self._lighting = read_table_pattern(stage.model), lighting
        self._rays: tuple[Lens, Floats, Floats] | None = None  # directions (3, N) in its frame, and lengths (N,)

    def draw_backdrop(self, lens: Lens, pose: FloatArray) -> Backdrop:
        """What there is to see through ``lens`` from ``pose`` (T_robot_cam)."""
        if self._rays is None or self._rays[0] != lens:
            local = np.ascontiguousarray(lens_ray_directions(lens).reshape(-1, 3).T, np.float32)
            self._rays = lens, local, np.sqrt(np.einsum("ij,ij->j", local, local))
        _, local, lengths = self._rays
        directions, eye = pose[:3, :3].astype(np.float32) @ local, pose[:3, 3].astype(np.float32)
        depth, color = np.full(len(lengths), np.inf, np.float32), np.empty((len(lengths), 3), np.uint8)
        for axis, side, rows, reach in self._visible_faces(eye, directions):
            color[rows] = self._color_of_face(eye, directions[:, rows], lengths[rows], reach, axis, side)
            depth[rows] = reach
        sky = np.flatnonzero(np.isinf(depth))
        above, below = np.array(SKY, np.float32) * 255
        color[sky] = below + ((1 + directions[2, sky] / lengths[sky]) / 2)[:, None] * (above - below)
        return Backdrop(lens, pose.copy(), directions, lengths, depth, color)

    def _visible_faces(self, eye: Floats, directions: Floats) -> Iterator[tuple[int, float, Indices | slice, Floats]]:
        """The faces of the table that ``eye`` (3,) sees: their axis and side, the rays that meet them and how far."""
        for axis in range(3):
            side = float(np.sign(eye[axis] - self._place[axis]))
            ahead = self._place[axis] + side * self._half[axis] - eye[axis]
            if ahead * side >= 0:  # the eye is not beyond this face
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = ahead / directions[axis]
                there = reach > 0
                for other in {0, 1, 2} - {axis}:
                    there &= np.abs(directions[other] * reach + (eye - self._place)[other]) <= self._half[other]
            rows = slice(None) if there.all() else np.flatnonzero(there)
            yield axis, side, rows, reach[rows]

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
        return np.minimum(light, 1) * pixels[rows, columns].astype(
            np.float32
        )  # OpenGL, too, bounds the light before it looks a color up
