"""Images by casting rays: colour, depth and which object, with no graphics library at all."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.geometry import FloatArray
from grs_agents.library import Library
from grs_agents.mujoco_import import mujoco
from grs_agents.sim.arms import Arm
from grs_agents.sim.instance import InstanceObject
from grs_agents.sim.world import compilation

_LIGHT = np.array([0.2, -0.3, 0.93])
_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
_NO_ARM = np.array([1, 0, 1, 0, 0, 0], dtype=np.uint8)


@dataclass(frozen=True)
class View:
    """A camera: where it is and what it looks at (m), its vertical field of view (deg), rows and columns."""

    position: Vec3
    target: Vec3
    field_of_view: float = 45.0
    height: int = 480
    width: int = 640


FRONT = View((1.35, 0.0, 0.75), (0.45, 0.0, 0.05))
LEFT = View((0.15, 0.85, 0.65), (0.5, 0.0, 0.05))
RIGHT = View((0.15, -0.85, 0.65), (0.5, 0.0, 0.05))


@dataclass(frozen=True)
class Picture:
    """color (H, W, 3) uint8; depth (H, W) float32 metres along the optical axis, 0 = nothing; owner (H, W) id or -1."""

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    owner: npt.NDArray[np.int32]


@dataclass(frozen=True)
class VisibleScene:
    """What there is to see."""

    objects: Sequence[InstanceObject]
    library: Library
    joints: FloatArray | None = None  # positions (dof,); None leaves the arm out
    arm: Arm | None = None  # None for the default
    tool: compilation.Tool = "suction"
    poses: Sequence[Pose] | None = None  # of the objects, where they do not stand as they say
    background: str | None = None  # library name of what stands fixed around the robot


def camera_ray_directions(view: View) -> FloatArray:
    """Directions (H * W, 3) with length 1 along the optical axis, robot frame."""
    forward = np.subtract(view.target, view.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([0.0, -1.0, 0.0])
    down = np.cross(forward, right)
    focal = view.height / 2 / np.tan(np.deg2rad(view.field_of_view) / 2)
    u, v = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    x, y = (u - view.width / 2) / focal, (v - view.height / 2) / focal
    return (forward + x[..., None] * right + y[..., None] * down).reshape(-1, 3)


def render_views(sight: VisibleScene, views: Sequence[View]) -> list[Picture]:
    """One picture for each view."""
    scene = _compile_visible_scene(sight)
    return [
        _trace_picture(
            scene, np.asarray(view.position), camera_ray_directions(view).reshape(view.height, view.width, 3), _GROUPS
        )
        for view in views
    ]


def render_along_rays(sight: VisibleScene, eye: FloatArray, directions: FloatArray) -> Picture:
    """The picture that rays (H, W, 3) from ``eye`` (m) make, each of length 1 along the optical axis."""
    return _trace_picture(_compile_visible_scene(sight), eye, directions, _NO_ARM if sight.joints is None else _GROUPS)


def _compile_visible_scene(sight: VisibleScene) -> compilation.World:
    scene = compilation.build_world(
        sight.objects, sight.library, visuals=True, arm=sight.arm, tool=sight.tool, background=sight.background
    )
    poses = [item.pose for item in sight.objects] if sight.poses is None else sight.poses
    pairs = zip(sight.objects, poses, strict=True)
    compilation.reset_world_to_poses(scene, [item.model_copy(update={"pose": pose}) for item, pose in pairs])
    if sight.joints is not None:
        scene.data.qpos[: len(sight.joints)] = sight.joints
    mujoco.mj_forward(scene.model, scene.data)
    return scene


def _trace_picture(
    scene: compilation.World, eye: FloatArray, directions: FloatArray, groups: npt.NDArray[np.uint8]
) -> Picture:
    shape = (directions.shape[0], directions.shape[1])
    count = shape[0] * shape[1]
    geom, distance, normal = np.full(count, -1, np.int32), np.empty(count), np.empty(3 * count)
    mujoco.mj_multiRay(
        scene.model, scene.data, eye, directions.ravel(), groups, 1, -1, geom, distance, normal, count, 1e10
    )
    hit = geom >= 0
    paint = np.asarray(scene.model.geom_rgba)[:, :3]
    shade = np.clip(np.abs(normal.reshape(-1, 3) @ _LIGHT), 0.3, 1.0)
    color = np.where(hit[:, None], paint[geom] * shade[:, None], 0.93) * 255
    owner = np.where(hit, np.asarray(scene.owners, dtype=np.int32)[geom], -1)
    depth = np.where(hit, distance, 0).astype(np.float32).reshape(shape)
    return Picture(color.astype(np.uint8).reshape(*shape, 3), depth, owner.reshape(shape))


def encode_png(color: npt.NDArray[np.uint8]) -> bytes:
    """An image (H, W, 3) as a PNG file's content."""
    height, width = color.shape[:2]
    rows = np.hstack([np.zeros((height, 1), np.uint8), color.reshape(height, -1)])  # filter type 0 before each row

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def render_observation(sight: VisibleScene) -> dict[str, tuple[npt.NDArray[Any], ...]]:
    """The three observation cameras: ``color`` and ``depth``."""
    pictures = render_views(sight, (FRONT, LEFT, RIGHT))
    return {"color": tuple(one.color for one in pictures), "depth": tuple(one.depth for one in pictures)}
