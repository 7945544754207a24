"""Images of a scene by ray casting: plain (a colour per geom) and textured."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.cameras import (
    FRONT,
    LEFT,
    RIGHT,
    LookAtCamera,
    RenderedImage,
    VisibleScene,
    camera_ray_directions,
)
from grs_agents.sim.rendering.ray_painter import RayCaster, RayPainter
from grs_agents.sim.rendering.stage import Props, Stage

_LIGHT: Final = np.array([0.2, -0.3, 0.93])
_SKY: Final = 0.93


def render_views(sight: VisibleScene, views: Sequence[LookAtCamera]) -> list[RenderedImage]:
    """An image per camera, the robot with its looks."""
    return _draw_views(_build_stage(sight, dressed=True), views)


def _draw_views(stage: Stage, views: Sequence[LookAtCamera]) -> list[RenderedImage]:
    return [
        _shade_rays(stage, np.asarray(view.position), camera_ray_directions(view).reshape(view.height, view.width, 3))
        for view in views
    ]


def render_along_rays(sight: VisibleScene, eye: FloatArray, directions: FloatArray) -> RenderedImage:
    """Image along rays (H, W, 3) from ``eye`` (m), each of length 1 along the optical axis; of the robot, its
    collision geometry."""
    return _shade_rays(_build_stage(sight), eye, directions)


def _build_stage(sight: VisibleScene, dressed: bool = False) -> Stage:
    arm = None if sight.joints is None else sight.arm or get_arm()
    props = Props(sight.objects, arm, sight.tool == "spatula", dressed, sight.background, textures=False)
    stage = Stage(props, sight.library)
    if sight.poses is not None:
        for item, (position, rotation) in zip(sight.objects, sight.poses, strict=True):
            stage.set_object_pose(item.id, np.array(position), np.array(rotation))
    if sight.joints is not None:
        stage.set_joint_positions(sight.joints)
    stage.update()
    return stage


def render_observation(sight: VisibleScene) -> dict[str, tuple[npt.NDArray[Any], ...]]:
    """``color`` and ``depth`` of the three observation cameras; of the robot, its collision geometry."""
    images = _draw_views(_build_stage(sight), (FRONT, LEFT, RIGHT))
    return {"color": tuple(image.color for image in images), "depth": tuple(image.depth for image in images)}


def _shade_rays(stage: Stage, eye: FloatArray, directions: FloatArray) -> RenderedImage:
    """Lambertian image along rays (H, W, 3) from ``eye`` (m), lit from above, a colour per geom."""
    shape = (directions.shape[0], directions.shape[1])
    hits = RayCaster(shape[0] * shape[1]).cast(stage, eye, directions.reshape(-1, 3))
    paint, hit = np.asarray(stage.model.geom_rgba)[:, :3], hits.geom >= 0
    shade = np.clip(np.abs(hits.normal @ _LIGHT), 0.3, 1.0)
    color = np.where(hit[:, None], paint[hits.geom] * shade[:, None], _SKY) * 255
    depth, owner = np.where(hit, hits.depth, 0), np.where(hit, stage.owners[hits.geom], np.int32(-1))
    return RenderedImage(
        color.astype(np.uint8).reshape(*shape, 3), depth.astype(np.float32).reshape(shape), owner.reshape(shape)
    )


def render_from_camera(props: Props, library: Library, lens: Lens, pose: FloatArray) -> RenderedImage:
    """Image of props through ``lens`` from ``pose``, T_robot_cam (4, 4), OpenCV axes, m.
    Raises ``InputError`` for meshes and textures that MuJoCo refuses."""
    painter = RayPainter(Stage(props, library), lens.height, lens.width)
    painter.prepare_view(lens, pose, arm=props.arm is not None)
    return RenderedImage(painter.draw_color(), *painter.draw_depth_and_owner())
