"""Things on the table in a world, and a photo with depth of them, without noise."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.perception.settling.settling import PlacedObject, prepare_world_for_settling, to_instance_objects
from grs_agents.perception.types import Camera, Mask, RGBDFrame, TableFrame
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays
from grs_agents.sim.world.compilation import World, build_world, reset_world_to_poses

WIDTH, HEIGHT, FOCAL = 240, 180, 300.0
LIBRARY = Library()
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
MILK, BLOCK = "HOPE/Milk.urdf", "block/red_block.urdf"


def standing(asset: str, x: float, y: float, above: float = 0.0) -> PlacedObject:
    """An upright asset so far above the table, m."""
    low, high = np.array(LIBRARY.load_object_model(asset).bounds)
    return PlacedObject(asset, ((x, y, above + float(high[2] - low[2]) / 2), UPRIGHT))


def world_of(*things: PlacedObject) -> World:
    """The things in a world, as `settle` begins with it; they are numbered from 0."""
    items = to_instance_objects(things, LIBRARY)
    world = build_world(items, LIBRARY)
    reset_world_to_poses(world, items)
    prepare_world_for_settling(world)
    mujoco.mj_forward(world.model, world.data)
    return world


def photo_of(things: Sequence[PlacedObject], library: Library) -> tuple[RGBDFrame, TableFrame, Mask]:
    """The photo, its pose, and the pixels of the things; the camera looks down by 45 degrees from 0.7 m."""
    slope = np.sqrt(0.5)
    turn = np.array([[0, -slope, slope], [-1, 0, 0], [0, -slope, -slope]])
    eye = np.array([0.0, 0.0, 0.55])
    camera = Camera(fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2, width=WIDTH, height=HEIGHT, depth_scale=0.001)
    rows, columns = np.indices((HEIGHT, WIDTH))
    local = np.stack([(columns - camera.cx) / FOCAL, (rows - camera.cy) / FOCAL, np.ones((HEIGHT, WIDTH))], axis=-1)
    picture = render_along_rays(
        VisibleScene(to_instance_objects(things, library), library), eye, np.asarray(local @ turn.T, np.float64)
    )
    matrix = tuple((*(float(value) for value in row), float(place)) for row, place in zip(turn, eye, strict=True))
    table = TableFrame(T_robot_cam=(*matrix, (0.0, 0.0, 0.0, 1.0)), origin="calibrated", residual=0.0, inliers=0.5)
    return RGBDFrame(picture.color, picture.depth, camera, Path("photo")), table, picture.owner >= 0
