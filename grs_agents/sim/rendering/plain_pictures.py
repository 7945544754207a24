"""Pictures by rays of what stands on the table: the same on every machine, each thing in its one colour."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.lenses import camera_ray_directions
from grs_agents.sim.rendering.rays import RayCaster
from grs_agents.sim.rendering.stage import Props, Stage
from grs_agents.sim.rendering.views import FRONT, LEFT, RIGHT, Picture, View, VisibleScene

_LIGHT: Final = np.array([0.2, -0.3, 0.93])
_SKY: Final = 0.93


def render_views(sight: VisibleScene, views: Sequence[View]) -> list[Picture]:
    """One picture for each view, the robot as it looks."""
    return _draw_views(_build_stage(sight, dressed=True), views)


def _draw_views(stage: Stage, views: Sequence[View]) -> list[Picture]:
    return [
        _shade_rays(stage, np.asarray(view.position), camera_ray_directions(view).reshape(view.height, view.width, 3))
        for view in views
    ]


def render_along_rays(sight: VisibleScene, eye: FloatArray, directions: FloatArray) -> Picture:
    """The picture that rays (H, W, 3) from ``eye`` (m) make, each of length 1 along the optical axis; of the robot,
    what touches things."""
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
    """The three observation cameras: ``color`` and ``depth``; a program sees of the robot what touches things."""
    pictures = _draw_views(_build_stage(sight), (FRONT, LEFT, RIGHT))
    return {"color": tuple(one.color for one in pictures), "depth": tuple(one.depth for one in pictures)}


def _shade_rays(stage: Stage, eye: FloatArray, directions: FloatArray) -> Picture:
    """What rays (H, W, 3) from ``eye`` (m) meet, lit from above, each thing in its one colour."""
    shape = (directions.shape[0], directions.shape[1])
    hits = RayCaster(shape[0] * shape[1]).cast(stage, eye, directions.reshape(-1, 3))
    paint, hit = np.asarray(stage.model.geom_rgba)[:, :3], hits.geom >= 0
    shade = np.clip(np.abs(hits.normal @ _LIGHT), 0.3, 1.0)
    color = np.where(hit[:, None], paint[hits.geom] * shade[:, None], _SKY) * 255
    depth, owner = np.where(hit, hits.depth, 0), np.where(hit, stage.owners[hits.geom], np.int32(-1))
    return Picture(
        color.astype(np.uint8).reshape(*shape, 3), depth.astype(np.float32).reshape(shape), owner.reshape(shape)
    )
