"""Helpers of CLIPort's and GenSim's ``Task`` that programs call while they set a scene up."""

from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat
from grs_agents.sim import templates, top_down, utils
from grs_agents.sim.episode import SimulationError, UnsupportedError
from grs_agents.sim.goals import as_pose

if TYPE_CHECKING:
    from grs_agents.sim.environment import Environment

FloatArray = npt.NDArray[np.float64]
_PILE: Final = 50
_GRAIN: Final = 0.02
_CORNER: Final = {"DIMX": 0.04, "DIMY": 0.04}
"""Lengths of an anchor's two legs, metres."""


class TaskKit:
    """What a task can call besides ``add_object`` and ``add_goal``."""

    def __init__(self) -> None:
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])
        self.pix_size = 0.003125
        self.mode = "train"
        self.assets_root = ""
        self.train_set: npt.NDArray[np.int64] = np.arange(0, 14)
        self.test_set: npt.NDArray[np.int64] = np.arange(14, 20)
        self._env: Environment | None = None

    @property
    def environment(self) -> "Environment":
        """The environment of the last reset.

        Raises:
            SimulationError: there was none.
        """
        if self._env is None:
            raise SimulationError("the task was not reset yet", "call env.set_task(task) and env.reset()")
        return self._env

    @property
    def rng(self) -> np.random.Generator:
        """The environment's random numbers: the same seed draws the same scene."""
        return self.environment.rng

    def get_random_size(
        self, min_x: float, max_x: float, min_y: float, max_y: float, min_z: float, max_z: float
    ) -> FloatArray:
        """A random size (3,) between bounds, metres."""
        return self.rng.uniform((min_x, min_y, min_z), (max_x, max_y, max_z))

    def get_true_image(
        self, env: "Environment"
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Colour (H, W, 3), height (H, W; m) and object id (H, W; 0 = none) of the workspace seen from above.

        Rows run along y, columns along x, ``pix_size`` metres each: ``utils.pix_to_xyz`` reads them.
        """
        return top_down.maps(env.objects, env.library, self.bounds, self.pix_size)

    def add_corner_anchor_for_pose(self, env: "Environment", pose: Any) -> int:
        """Mark a pose on the table with an L of two thin lines that nothing touches; returns its id."""
        placed = as_pose(pose if len(pose) == 2 else (pose, utils.IDENTITY), "add_corner_anchor_for_pose")
        corner = templates.fill(env.library, "corner/corner-template.urdf", _CORNER)
        return env.add_object(corner, placed, "fixed")

    def color_random_brown(self, obj: int) -> None:
        """Paint an object a random shade of brown."""
        shade = float(self.rng.uniform(0.5, 1.5))
        self.environment.set_color(obj, [shade * channel for channel in utils.COLORS["brown"]])

    def check_require_obj(self, path: str) -> bool:
        """Whether the library has an asset."""
        library = self._env.library if self._env is not None else templates.default_library()
        return templates.asset_name(path, library) in library

    def make_piles(self, env: "Environment", block_color: Any = None, *_: Any, **__: Any) -> list[int]:
        """Strew 50 cubes of 2 cm over a patch of the table; returns their ids."""
        urdf = templates.fill(env.library, "box/box-template.urdf", {"DIM": (_GRAIN,) * 3})
        low = self.bounds[:2, 0] + (0.15, 0.4)
        # Cells of a grid that hold a cube however it is turned, so that none starts inside another.
        cells = np.stack(np.meshgrid(np.arange(8), np.arange(8), indexing="ij"), axis=-1).reshape(-1, 2)
        chosen = env.rng.permutation(cells)[:_PILE]
        found: list[int] = []
        for cell in chosen:
            x, y = low + (cell + 0.5) * 1.45 * _GRAIN
            rotation = utils.eulerXYZ_to_quatXYZW((0.0, 0.0, float(env.rng.uniform(-np.pi, np.pi))))
            found.append(env.add_object(urdf, ((float(x), float(y), _GRAIN / 2), rotation), color=block_color))
        return found

    def make_ropes(self, *_: Any, **__: Any) -> list[int]:
        """Lay a rope.

        Raises:
            UnsupportedError: always, bodies that bend are not there yet.
        """
        raise UnsupportedError("ropes are not there yet", "use rigid objects")

    make_rope = make_ropes

    def get_kitting_shapes(self, n_objects: int) -> npt.NDArray[np.int64]:
        """Numbers of ``n_objects`` kitting shapes: of ``train_set``, or of ``test_set`` if ``mode`` is ``'test'``."""
        if self.mode == "train":
            return self.rng.choice(self.train_set, n_objects)
        unseen = self.test_set
        if len(unseen) < n_objects:
            raise SimulationError(f"there are {len(unseen)} test shapes, {n_objects} were asked for", "ask for fewer")
        return self.rng.choice(unseen, n_objects, replace=False)

    def make_kitting_objects(self, *_: Any, **__: Any) -> Any:
        """Put kitting shapes on the table.

        Raises:
            UnsupportedError: always, the library has no kitting shapes yet.
        """
        raise UnsupportedError("the library has no kitting shapes yet", "use blocks and boxes")

    def get_box_object_points(self, obj: int) -> FloatArray:
        """Points (3, N) spread over an object's collision volume, object frame, metres."""
        return np.copy(self.environment.volume(obj).points)

    def get_target_sample_surface_points(
        self, model: str, scale: Sequence[float], pose: Pose, num_points: int = 50
    ) -> list[tuple[tuple[float, float, float], Quat]]:
        """``num_points`` poses spread at random over a library mesh, e.g. ``"kitting/03.obj"``, scaled and placed.

        Args:
            model: file name of the mesh, folders in front of the library's own do not matter.
            scale: factors of its x, y, z.
            pose: where the mesh lies, robot frame.
            num_points: how many.
        """
        import trimesh

        library, name = self.environment.library, "/".join(PurePosixPath(model.replace("\\", "/")).parts[-2:])
        mesh: Any = trimesh.load_mesh(library.mesh_path(name))
        found: list[FloatArray] = []
        while sum(len(points) for points in found) < num_points:
            found.append(trimesh.sample.volume_mesh(mesh, num_points * 3))
        spread = utils.apply(pose, np.vstack(found)[:num_points].T * np.asarray(scale)[:, None])
        return [(utils.vec3(point), utils.IDENTITY) for point in spread.T]

    get_sphere_object_points = get_box_object_points
    get_mesh_object_points = get_box_object_points
