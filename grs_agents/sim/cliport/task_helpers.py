"""Helpers of CLIPort's and GenSim's ``Task`` that programs call while they set a scene up."""

from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat
from grs_agents.geometry import transforms
from grs_agents.sim.cliport import rope, top_down_maps
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.goals.task_accounting import Ledger
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.world import templates
from grs_agents.sim.world.colors import COLORS
from grs_agents.sim.world.tabletop import as_pose

FloatArray = npt.NDArray[np.float64]
_GRAIN: Final = "block/small.urdf"
"""A cube of 1 cm."""
_CELL: Final = 0.0145
"""A cell that holds it however it is turned, metres."""
_CORNER: Final = {"DIMX": 0.04, "DIMY": 0.04}
"""Where an anchor's two strokes lie, as GenSim has them, metres."""


class TaskKit:
    """What a task can call besides ``add_object`` and ``add_goal``."""

    grs: Ledger

    def __init__(self) -> None:
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])
        self.pix_size = 0.003125
        self.mode = "train"
        self.assets_root = ""
        self.train_set: npt.NDArray[np.int64] = np.arange(0, 14)
        self.test_set: npt.NDArray[np.int64] = np.arange(14, 20)
        self.num_blocks = 50

    @property
    def rng(self) -> np.random.Generator:
        """The environment's random numbers, or the program's own: the same seed draws the same scene."""
        return self.grs.rng or self.grs.env.rng

    @rng.setter
    def rng(self, rng: np.random.Generator) -> None:
        self.grs.rng = rng

    def get_random_size(
        self, min_x: float, max_x: float, min_y: float, max_y: float, min_z: float, max_z: float
    ) -> FloatArray:
        """A random size (3,) between bounds, metres."""
        return self.rng.uniform((min_x, min_y, min_z), (max_x, max_y, max_z))

    def get_true_image(
        self, env: Environment
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Colour (H, W, 3), height (H, W; m) and object id (H, W; 0 = none) of the workspace seen from above.

        Rows run along y, columns along x, ``pix_size`` metres each: ``utils.pix_to_xyz`` reads them.
        """
        return top_down_maps.maps(env.objects, env.library, self.bounds, self.pix_size)

    def add_corner_anchor_for_pose(self, env: Environment, pose: Any) -> int:
        """Mark a pose on the table with an L of two thin lines that nothing touches; returns its id."""
        placed = as_pose(pose if len(pose) == 2 else (pose, transforms.IDENTITY), "add_corner_anchor_for_pose")
        corner = templates.fill(env.library, "corner/corner-template.urdf", _CORNER)
        return env.add_object(corner, placed, "fixed")

    def color_random_brown(self, obj: int) -> None:
        """Paint an object a random shade of brown."""
        shade = float(self.rng.uniform(0.5, 1.5))
        self.grs.env.set_color(obj, [shade * channel for channel in COLORS["brown"]])

    def check_require_obj(self, path: str) -> bool:
        """Whether the library has an asset."""
        env = self.grs.reset_in
        library = env.library if env is not None else templates.default_library()
        return templates.asset_name(path, library) in library

    def make_piles(self, env: Environment, block_color: Any = None, *_: Any, **__: Any) -> list[int]:
        """Strew ``num_blocks`` cubes of 1 cm over a patch of 20 cm in the middle of the table; returns their ids.

        Raises:
            SimulationError: so many do not lie there side by side.
        """
        low, side = self.bounds[:2, 0] + (0.15, 0.4), int(0.2 / _CELL)
        if not 0 <= self.num_blocks <= side**2:
            raise SimulationError(
                f"make_piles: num_blocks is {self.num_blocks}, {side**2} have room side by side", "ask for fewer"
            )
        # A cube a cell, so that none starts inside another.
        cells = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1).reshape(-1, 2)
        found: list[int] = []
        for cell in env.rng.permutation(cells)[: self.num_blocks]:
            x, y = low + (cell + 0.5) * 0.2 / side
            rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(env.rng.uniform(-np.pi, np.pi))))
            found.append(env.add_object(_GRAIN, ((float(x), float(y), 0.005), rotation), color=block_color))
        return found

    def make_ropes(
        self, env: Environment, corners: Any, radius: float = 0.005, n_parts: int = 20, color_name: str = "red",
        *_: Any, **__: Any,
    ) -> tuple[list[tuple[int, tuple[float, None]]], list[Pose], npt.NDArray[np.float64]]:  # fmt: skip
        """Lay a rope of beads on a free place of the table, in a gentle curve.

        Args:
            env: where.
            corners: two points (or poses): between them the rope is to lie in the end, and so long it is.
            radius: of a bead, metres.
            n_parts: how many beads.
            color_name: of all but the two ends, which are white.

        Returns:
            What ``add_goal`` takes: ``objs``, ``targ_poses`` along the line, and ``matches`` for either direction.

        Raises:
            NoFreeSpaceError: there is no room for it.
        """
        return rope.make(env, self.bounds, corners, radius, int(n_parts), color_name)

    make_rope = make_ropes

    def get_kitting_shapes(self, n_objects: int) -> npt.NDArray[np.int64]:
        """Numbers of ``n_objects`` kitting shapes: of ``train_set``, or of ``test_set`` if ``mode`` is ``'test'``."""
        if self.mode == "train":
            return self.rng.choice(self.train_set, n_objects)
        unseen = self.test_set
        if len(unseen) < n_objects:
            raise SimulationError(f"there are {len(unseen)} test shapes, {n_objects} were asked for", "ask for fewer")
        return self.rng.choice(unseen, n_objects, replace=False)

    def get_box_object_points(self, obj: int) -> FloatArray:
        """Points (3, N) spread over an object's collision volume, object frame, metres."""
        return np.copy(self.grs.env.volume(obj).points)

    def get_target_sample_surface_points(
        self, model: str, scale: Sequence[float], pose: Pose, num_points: int = 50
    ) -> list[tuple[tuple[float, float, float], Quat]]:
        """``num_points`` poses spread evenly over a library mesh as seen from above, scaled and placed.

        Args:
            model: file name of the mesh, e.g. ``"kitting/03.obj"``; what precedes that does not matter.
            scale: factors of its x, y, z.
            pose: where the mesh lies, robot frame.
            num_points: how many.

        Raises:
            InputError: the mesh cannot be read.
        """
        import trimesh

        library, name = self.grs.env.library, "/".join(PurePosixPath(model.replace("\\", "/")).parts[-2:])
        mesh: Any = trimesh.load_mesh(library.mesh_path(name))
        points = _over(np.asarray(mesh.triangles, dtype=np.float64) * np.asarray(scale), num_points, self.rng)
        return [(transforms.vec3(point), transforms.IDENTITY) for point in transforms.apply(pose, points.T).T]

    get_sphere_object_points = get_box_object_points
    get_mesh_object_points = get_box_object_points


def _over(triangles: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points (count, 3) drawn evenly, as seen from above, from those of the triangles (N, 3, 3) that face upwards."""
    corner, first, second = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.maximum(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0], 0.0)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    share = rng.uniform(size=(count, 2))
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    return np.asarray(corner[chosen] + share[:, :1] * first[chosen] + share[:, 1:] * second[chosen])
