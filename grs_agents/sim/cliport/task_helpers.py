"""Helpers of CLIPort's and GenSim's ``Task`` that programs call while they set a scene up.

They make ropes (beads in a row, each tied to the next at a point, laid on the table in a gentle curve) and kitting
shapes (as GenSim's ``make_kitting_objects`` puts them there).
"""

import itertools
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.mesh_files import read_surface
from grs_agents.sim.cliport import cameras
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.episode import NoFreeSpaceError, SimulationError
from grs_agents.sim.instance.task_instance import InstanceTie
from grs_agents.sim.motion import placement
from grs_agents.sim.tabletop import TabletopSim, parse_pose
from grs_agents.sim.tabletop_episode import GoalTask
from grs_agents.sim.world import templates
from grs_agents.sim.world.colors import COLORS
from grs_agents.sim.world.context import PROCESS_CONTEXT
from grs_agents.sim.world.footprints import rotation_matrix_2d

_BEAD: Final = "sphere/sphere_rope.urdf"
_BEAD_RADIUS: Final = 0.005
_BENDS: Final = (1.0, 1.0, 1.6, 2.4, 3.2, 4.2)
"""Total bends of a rope that are tried, radians: gentle first, more where there is little room."""
_TRIES: Final = 12


def add_rope(
    env: TabletopSim, bounds: FloatArray, corners: Any, radius: float, n_parts: int, color_name: str
) -> tuple[list[tuple[int, tuple[float, None]]], list[Pose], FloatArray]:
    """Add a rope as ``Task.make_ropes`` does.

    Raises ``SimulationError`` for beads that are too few or do not fit, ``NoFreeSpaceError`` where there is no room.
    """
    ends: list[FloatArray] = []
    for corner in corners:
        point = np.asarray(corner[0] if np.ndim(corner[0]) else corner, dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise SimulationError(f"make_ropes: corner {corner!r} is no point", "give (x, y, z) in metres")
        ends.append(point)
    first, last = ends
    step = (last - first) / max(n_parts, 1)
    spacing = float(np.linalg.norm(step))
    if n_parts < 2 or spacing < 0.002:
        raise SimulationError(
            f"make_ropes: {n_parts} beads over {spacing * n_parts:.3f} m", "give two corners apart, and more beads"
        )
    radius = min(radius, spacing / 2)
    points = _find_free_rope_curve(env, bounds, n_parts, spacing, radius)
    urdf, color = _BEAD, None if color_name == "red" else color_name
    if abs(radius - _BEAD_RADIUS) > 1e-6:
        urdf = templates.fill_template(env.library, "sphere/sphere-template.urdf", {"DIM": (2 * radius,) * 3})
        color = color_name
    numbers: list[int] = []
    ways = np.diff(points, axis=0, append=2 * points[-1:] - points[-2:-1])  # each bead's x axis points to the next
    for index, ((x, y), (dx, dy)) in enumerate(zip(points, ways, strict=True)):
        rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(np.arctan2(dy, dx))))
        shade = "white" if index in (0, len(points) - 1) else color
        numbers.append(env.add_object(urdf, ((float(x), float(y), radius), rotation), color=shade))
    for parent, child in pairwise(numbers):
        env.tie_objects(
            InstanceTie(
                kind="point",
                parent=parent,
                child=child,
                parent_frame=((spacing, 0.0, 0.0), transforms.IDENTITY),
                child_frame=((0.0, 0.0, 0.0), transforms.IDENTITY),
            )
        )
    targets = [(transforms.to_vec3(first + (index + 0.5) * step), transforms.IDENTITY) for index in range(n_parts)]
    matches = np.clip(np.eye(n_parts) + np.eye(n_parts)[::-1], 0, 1)
    return [(number, (0.0, None)) for number in numbers], targets, matches


def _find_free_rope_curve(
    env: TabletopSim, bounds: FloatArray, count: int, spacing: float, radius: float
) -> FloatArray:
    """Points (count, 2) of a curve with equal steps that lies free on the table, within reach."""
    everything = [env.object_prism(item.id) for item in env.objects]
    solid = [env.object_prism(item.id) for item in env.objects if env.object_model(item.id).colliders]
    for obstacles, bend in itertools.product((everything, solid), _BENDS):  # on marks only where else there is no room
        for _ in range(_TRIES):
            bent = bend * float(env.rng.uniform(0.5, 1.0) * env.rng.choice([-1.0, 1.0]))  # radians along the arc
            headings = bent * (np.arange(count - 1) / max(count - 2, 1) - 0.5)
            steps = spacing * np.stack([np.cos(headings), np.sin(headings)], axis=1)
            curve = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
            curve = curve - (curve.min(axis=0) + curve.max(axis=0)) / 2
            size = (*(np.ptp(curve, axis=0) + 2 * radius), 2 * radius)
            pose = placement.sample_free_pose(size, bounds, obstacles, env.rng, env.arm)
            if pose is None:
                break
            points = curve @ rotation_matrix_2d(transforms.yaw_of_quaternion(pose[1])).T + np.asarray(pose[0][:2])
            if env.arm.reachable_mask(np.column_stack([points, np.full(count, 2 * radius)])).all():
                return points
    raise NoFreeSpaceError(
        f"no free place for a rope of {count} beads, {count * spacing:.2f} m, among {len(env.objects)} objects",
        "add fewer objects or a shorter rope",
    )


_GRAIN: Final = "block/small.urdf"
"""A cube of 1 cm."""
_CELL: Final = 0.0145
"""Side of a cell that holds it at any yaw, metres."""
_CORNER: Final = {"DIMX": 0.04, "DIMY": 0.04}
"""Positions of an anchor's two strokes, as in GenSim, metres."""


KIT_LETTERS: Final = {"R": 0, "A": 1, "T": 5, "O": 11, "G": 12, "V": 13, "E": 14, "L": 15, "M": 19}
"""The kitting shapes that look like a letter; O is the disk."""


class TaskKit(GoalTask):
    """CLIPort's helper methods and attributes of a task."""

    def __init__(self) -> None:
        super().__init__()
        self.pix_size = 0.003125
        self.mode = "train"
        self.assets_root = ""
        self.train_set: npt.NDArray[np.int64] = np.arange(0, 14)
        self.test_set: npt.NDArray[np.int64] = np.arange(14, 20)
        self.num_blocks = 50
        self.homogeneous = False
        self.continuous = False
        self.task_difficulty_level = "easy"
        self.kit = dict(KIT_LETTERS)
        self._early_rng = np.random.default_rng(PROCESS_CONTEXT.seed)

    def set_assets_root(self, assets_root: str) -> None:
        """Kept for CLIPort programs: names of assets are the library's, whatever folder stands before them."""
        self.assets_root = assets_root

    def get_asset_full_path(self, path: str) -> str:
        """The library's name of an asset; leading folders are ignored."""
        return path

    def zip_obj_ids(self, obj_ids: Sequence[Any], symmetries: Sequence[float] | None) -> list[Any]:
        """``[(id, (symmetry, None)), ...]`` as ``objs`` of a goal; pairs stay as they are."""
        if len(obj_ids) and isinstance(obj_ids[0], tuple):
            return list(obj_ids)
        angles = [0.0] * len(obj_ids) if symmetries is None else symmetries
        return [(number, (angle, None)) for number, angle in zip(obj_ids, angles, strict=False)]

    @property
    def rng(self) -> np.random.Generator:
        """The environment's random generator, or the program's own; before the first reset that of the process's seed.

        The same seed draws the same scene.
        """
        if self.grs.rng is None and self.grs.reset_in is None:
            return self._early_rng
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
        """Colour (H, W, 3), height (H, W; m) and object id (H, W; 0 = none) from above, ``pix_size`` metres a pixel."""
        return cameras.render_top_down_maps(env.objects, env.library, self.bounds, self.pix_size)

    def add_corner_anchor_for_pose(self, env: Environment, pose: Any) -> int:
        """Mark a pose on the table with an L of two thin lines that nothing touches; returns its id."""
        placed = parse_pose(pose if len(pose) == 2 else (pose, transforms.IDENTITY), "add_corner_anchor_for_pose")
        corner = templates.fill_template(env.library, "corner/corner-template.urdf", _CORNER)
        return env.add_object(corner, placed, "fixed")

    def color_random_brown(self, obj: int) -> None:
        """Paint an object a random shade of brown."""
        shade = float(self.rng.uniform(0.5, 1.5))
        self.grs.env.set_color(obj, [shade * channel for channel in COLORS["brown"]])

    def check_require_obj(self, path: str) -> bool:
        """Whether the library has an asset."""
        env = self.grs.reset_in
        library = env.library if env is not None else PROCESS_CONTEXT.get_library()
        return templates.resolve_asset_name(path, library) in library

    def make_piles(self, env: Environment, block_color: Any = None, *_more: Any, **_unknown: Any) -> list[int]:
        """Strew ``num_blocks`` cubes of 1 cm over a patch of 20 cm in the middle of the table; returns their ids.

        Raises:
            SimulationError: so many do not lie there side by side.
        """
        asked = _unknown.pop("num_blocks", _more[0] if _more else None)
        piles = int(_unknown.pop("count", 1))  # LoHo-Ravens': so many piles, apart, as a list of each
        env.warn_of_unknown_arguments("task.make_piles", _unknown, TaskKit.make_piles)
        listed = cast(Sequence[Any], block_color) if isinstance(block_color, list | tuple) else ()
        several = len(listed) > 0 and not isinstance(listed[0], float | int | np.number)  # else a single colour
        count = self.num_blocks if asked is None else int(asked)
        colors: list[Any] = list(listed) if several else [cast(Any, block_color)]
        if piles <= 1:
            return _strew_pile(env, self.bounds[:2, 0] + (0.15, 0.4), 0.2, count, colors)
        corners = [self.bounds[:2, 0] + 0.3 / piles * (index + 1) for index in range(piles)]
        shades = [colors[index % len(colors)] for index in range(piles)]
        strewn = [_strew_pile(env, low, 0.15, count, [shade]) for low, shade in zip(corners, shades, strict=True)]
        return cast(Any, strewn)

    def make_ropes(
        self,
        env: Environment,
        corners: Any,
        radius: float = 0.005,
        n_parts: int = 20,
        color_name: str = "red",
        *_: Any,
        **_unknown: Any,
    ) -> tuple[list[tuple[int, tuple[float, None]]], list[Pose], FloatArray]:
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
        env.warn_of_unknown_arguments("task.make_ropes", _unknown, TaskKit.make_ropes)
        return add_rope(env, self.bounds, corners, radius, int(n_parts), color_name)

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
        return np.copy(self.grs.env.object_collision_points(obj).points)

    def get_target_sample_surface_points(
        self, model: str, scale: Sequence[float], pose: Pose, num_points: int = 50
    ) -> list[tuple[tuple[float, float, float], Quat]]:
        """``num_points`` poses spread over a library mesh (``kitting/03.obj``), scaled, placed, seen from above."""
        library, name = self.grs.env.library, "/".join(PurePosixPath(model.replace("\\", "/")).parts[-2:])
        surface = read_surface(library.mesh_or_texture_path(name))
        triangles = surface.corners * np.asarray(scale)
        corner, first, second = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        area = np.maximum(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0], 0.0)  # of those that face upwards
        chosen = self.rng.choice(len(area), num_points, p=area / area.sum())
        share = self.rng.uniform(size=(num_points, 2))
        share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
        points = corner[chosen] + share[:, :1] * first[chosen] + share[:, 1:] * second[chosen]
        return [
            (transforms.to_vec3(point), transforms.IDENTITY) for point in transforms.transform_points(pose, points.T).T
        ]

    get_sphere_object_points = get_box_object_points
    get_mesh_object_points = get_box_object_points


def _strew_pile(env: Environment, low: FloatArray, width: float, count: int, colors: Sequence[Any]) -> list[int]:
    """Strew cubes over a square patch with its low corner (2,), each in a free cell, so that none starts in another."""
    side = int(width / _CELL)
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1).reshape(-1, 2)
    strewn = np.array([item.pose[0][:2] for item in env.objects if item.asset == _GRAIN]).reshape(-1, 2)
    centers = low + (cells + 0.5) * width / side
    cells = cells[(np.linalg.norm(centers[:, None] - strewn, axis=2) > _CELL).all(axis=1)]
    if not 0 <= count <= len(cells):
        raise SimulationError(
            f"make_piles: num_blocks is {count}, {len(cells)} have room side by side", "ask for fewer"
        )
    ids: list[int] = []
    for number, cell in enumerate(env.rng.permutation(cells)[:count]):
        x, y = low + (cell + 0.5) * width / side
        rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(env.rng.uniform(-np.pi, np.pi))))
        ids.append(env.add_object(_GRAIN, ((float(x), float(y), 0.005), rotation), color=colors[number % len(colors)]))
    return ids


_FOLDS: Final = (1, 1, 3, 4, 4, 1, 2, 5, 2, 4, 5, 0, 1, 1, 1, 1, 0, 6, 1, 1)
SYMMETRIES: Final = tuple(2 * np.pi / fold if fold else 0.0 for fold in _FOLDS)
"""Rotational symmetry of each kitting shape, radians; 0 = any angle."""
SCALE: Final = (0.003, 0.003, 0.001)
SIZE: Final = (0.08, 0.08, 0.02)
"""Largest extents of a shape at this scale, metres."""


def add_kitting_objects(
    env: TabletopSim,
    place: Callable[[Sequence[float]], Any],
    targets: Sequence[Any],
    shapes: Sequence[int],
    colors: Sequence[Any],
) -> tuple[list[tuple[int, tuple[float, None]]], list[FloatArray]]:
    """Add an object of each shape (0..19) at the free pose that ``place`` gives for its size (m).

    Returns ``[(id, (symmetry, None)), ...]``, and for each object its row of ``matches``: 1 at targets of its shape.
    Raises ``SimulationError`` for an unknown shape or too few colours, ``NoFreeSpaceError`` without a free place.
    """
    unknown = [shape for shape in shapes if not 0 <= shape < len(SYMMETRIES)]
    if unknown or len(colors) < len(shapes):
        raise SimulationError(
            f"make_kitting_objects: shapes {list(shapes)} with {len(colors)} colours",
            f"give shapes 0..{len(SYMMETRIES) - 1} and a colour for each",
        )
    kinds = np.asarray(shapes)
    objects: list[tuple[int, tuple[float, None]]] = []
    matches: list[FloatArray] = []
    for shape, color in zip(shapes, colors, strict=False):
        replace = {"FNAME": f"{shape:02d}.obj", "SCALE": SCALE, "COLOR": color}
        urdf = templates.fill_template(env.library, "kitting/object-template.urdf", replace)
        number = env.add_object(urdf, place(SIZE))
        objects.append((number, (SYMMETRIES[shape], None)))
        row = np.zeros(len(targets))
        row[np.flatnonzero(kinds[: len(targets)] == shape)] = 1
        matches.append(row)
    return objects, matches
