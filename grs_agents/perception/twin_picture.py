"""Pictures of the textured twin from the photo's camera, or from beside it."""

from pathlib import Path

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.geometry.transforms import rotation_about_axis
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.rendering.cameras import RenderedImage, encode_png, resize_lens
from grs_agents.sim.rendering.pictures import render_from_camera
from grs_agents.sim.rendering.stage import Props

TWIN = "scene/twin.png"


def save_twin_picture(scene: SceneDescription, library: Library, run: Path) -> dict[str, str]:
    """Write ``scene/twin.png``, the twin from the photo's camera; returns this name. Errors as `draw_twin`."""
    write_bytes(run / TWIN, encode_png(draw_twin(scene, library).color))
    return {"twin": TWIN}


def draw_twin(scene: SceneDescription, library: Library, aside: float = 0.0) -> RenderedImage:
    """Render the objects of a scene at rest, on a table with the photo's appearance.

    Args:
        scene: with the photo's camera.
        library: of the assets, with the scene's proxies.
        aside: angle (rad) by which the camera orbits about its upward axis through the middle of the objects; it keeps
            looking down on the table.

    Returns:
        A picture as large as the photo, or as ``DEFAULT.settling.picture_side`` allows; its owners are the numbers of
        the objects.

    Raises:
        InputError: the description is of a version without the camera, or a mesh cannot be rendered.
    """
    camera = scene.camera
    if camera is None:
        raise InputError("scene.json does not tell the photo's camera", "make it again with `grs scene`")
    placed = [PlacedObject(item.asset, item.settled or (item.position, item.orientation)) for item in scene.objects]
    numbered = zip(to_instance_objects(placed, library), scene.objects, strict=True)
    items = [instance.model_copy(update={"id": item.id}) for instance, item in numbered]
    scale = min(1.0, DEFAULT.settling.picture_side / max(camera.width, camera.height))
    lens = Lens(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    lens = resize_lens(lens, round(camera.height * scale), round(camera.width * scale))
    pose = np.array(scene.frame.T_robot_cam, np.float64)
    if aside:
        middle = np.mean([item.position for item in scene.objects], axis=0)
        turn = rotation_about_axis(-pose[:3, 1], aside)
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] = turn @ (pose[:3, 3] - middle) + middle
    return render_from_camera(Props(items, table=scene.instance_table), library, lens, pose)
