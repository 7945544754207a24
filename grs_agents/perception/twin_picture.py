"""The twin with the textures of its assets, as the photo's camera sees it, or as one beside it would."""

from pathlib import Path

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.geometry.transforms import rotation_about_axis
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import Array, SceneDescription
from grs_agents.sim.rendering.lenses import resize_lens
from grs_agents.sim.rendering.stage import Props
from grs_agents.sim.rendering.textured_pictures import render_from_camera
from grs_agents.sim.rendering.views import Picture, encode_png

TWIN = "scene/twin.png"


def save_twin_picture(scene: SceneDescription, library: Library, run: Path) -> dict[str, str]:
    """Write ``scene/twin.png``, the twin from the photo's camera; returns this name. Errors as `draw_twin`."""
    write_bytes(run / TWIN, encode_png(draw_twin(scene, library).color))
    return {"twin": TWIN}


def draw_twin(scene: SceneDescription, library: Library, aside: float = 0.0) -> Picture:
    """The objects of a scene where they rest, on a table that looks as the photo's.

    Args:
        scene: with the photo's camera.
        library: that holds the scene's own shapes too.
        aside: how far (rad) the camera is turned about its own upward axis through the middle of the objects: over a
            table, always to a view from above.

    Returns:
        A picture as large as the photo, or as ``DEFAULT.settling.picture_side`` allows; its owners are the numbers of
        the objects.

    Raises:
        InputError: the description is of before it told the camera, or a mesh cannot be shown.
    """
    camera = scene.camera
    if camera is None:
        raise InputError("scene.json does not tell the photo's camera", "make it again with `grs scene`")
    placed = [PlacedObject(one.asset, one.settled or (one.position, one.orientation)) for one in scene.objects]
    numbered = zip(to_instance_objects(placed, library), scene.objects, strict=True)
    items = [item.model_copy(update={"id": one.id}) for item, one in numbered]
    scale = min(1.0, DEFAULT.settling.picture_side / max(camera.width, camera.height))
    lens = Lens(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    lens = resize_lens(lens, round(camera.height * scale), round(camera.width * scale))
    return render_from_camera(
        Props(items, table=scene.instance_table), library, lens, _camera_pose_turned_aside(scene, aside)
    )


def _camera_pose_turned_aside(scene: SceneDescription, aside: float) -> Array:
    """T_robot_cam (4, 4) of the photo's camera, turned by ``aside`` (rad) about the middle of the objects."""
    pose = np.array(scene.frame.T_robot_cam, np.float64)
    if not aside:
        return pose
    middle = np.mean([one.position for one in scene.objects], axis=0)
    turn = rotation_about_axis(-pose[:3, 1], aside)
    pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] = turn @ (pose[:3, 3] - middle) + middle
    return pose
