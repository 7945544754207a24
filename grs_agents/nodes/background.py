"""The background of a photo: from its pixels to an asset of the run."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library import write_background
from grs_agents.nodes.services import Services
from grs_agents.perception import Candidate, RGBDFrame, TableFrame, reconstruct
from grs_agents.sim.world.compilation import arm_at_home
from grs_agents.trace import SceneStage


def stand_in(
    frame: RGBDFrame, table: TableFrame, candidates: Sequence[Candidate], services: Services
) -> tuple[str, list[str]]:
    """Reconstruct what is left of a photo, if the configuration says so, and write it beside the proxies of the run.

    Args:
        frame: the photo with depth.
        table: the table in it, with the robot placed.
        candidates: what is not left.
        services: of the run.

    Returns:
        The library name of the background, empty without one, and what a reader of the scene should know.

    Raises:
        ConfigError: it is asked for, and scikit-image is not installed.
    """
    asked = services.config.background
    if not asked.on:
        return "", []
    objects = np.zeros(frame.depth.shape, np.bool_)
    for one in candidates:
        objects |= one.mask
    arm = arm_at_home(services.robot, services.library)
    found = reconstruct(frame, table, objects, [one.box for one in candidates], arm, asked.voxel)
    if found is None:
        return "", ["the photo shows nothing but table and objects near the robot: there is no background"]
    folder = services.folder / "assets"
    folder.mkdir(exist_ok=True)
    name = write_background(folder, found.mesh.vertices, found.mesh.faces, found.boxes, found.color)
    low, high = found.boxes[:, 0].min(axis=0), found.boxes[:, 1].max(axis=0)
    summary = {
        "asset": name,
        "faces": len(found.mesh.faces),
        "boxes": len(found.boxes),
        "pixels": found.pixels,
        "low": [round(float(value), 3) for value in low],
        "high": [round(float(value), 3) for value in high],
    }
    services.log.append(SceneStage(stage="background", summary=summary))
    return name, []
