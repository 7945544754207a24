"""The described scene as assets that stand where the photo shows them, and as the camera of the photo would see it."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.library import Library
from grs_agents.library.shapes import rotation_matrix
from grs_agents.sim.instance import InstanceObject
from grs_agents.sim.world import model_of


def run_library(folder: Path, library: Library) -> Library:
    """``library`` with the assets laid over that the run has made so far."""
    own = folder / "assets"
    return _overlaid(library, own, changed(own / "manifest.json")) if own.is_dir() else library


@lru_cache(maxsize=2)
def _overlaid(library: Library, own: Path, _written: int) -> Library:
    """Kept, since reading a manifest takes longer than showing its assets."""
    return library.overlay(own)


def changed(file: Path) -> int:
    """When ``file`` was written last (ns), by which what was read of it can be kept; 0 where there is none."""
    return file.stat().st_mtime_ns if file.is_file() else 0


def twin_objects(objects: Sequence[dict[str, Any]], library: Library) -> list[InstanceObject]:
    """The matched objects of a scene's summary, where they came to rest in the twin if it says so."""
    found: list[InstanceObject] = []
    for item in objects:
        if item.get("asset") in library and item.get("position") and item.get("orientation"):
            x, y, z = item["position"]
            qx, qy, qz, qw = item["orientation"]
            pose = item.get("settled") or ((x, y, z), (qx, qy, qz, qw))
            thing = InstanceObject(id=int(item["id"]), asset=str(item["asset"]), pose=pose)
            found.append(thing.model_copy(update={"pose": _about_origin(thing, library)}))
    return found


def _about_origin(thing: InstanceObject, library: Library) -> Pose:
    """A scene tells where an asset's centre is; a world places its origin."""
    low, high = model_of(thing, library).bounds
    middle = (np.array(low) + np.array(high)) / 2
    x, y, z = np.array(thing.pose[0]) - rotation_matrix(thing.pose[1]) @ middle
    return ((float(x), float(y), float(z)), thing.pose[1])


def twin_picture(
    objects: Sequence[InstanceObject],
    library: Library,
    camera: dict[str, Any],
    background: str | None = None,
    width: int = 640,
) -> npt.NDArray[np.uint8]:
    """The twin (H, ``width``, 3) as the camera of the photo would see it, made of rays.

    Args:
        objects: of :func:`twin_objects`.
        library: 3D assets.
        camera: ``fx``, ``fy``, ``cx``, ``cy``, ``width``, ``height`` in pixels and ``T_robot_cam``.
        background: library name of what stands around, or None.
        width: of the picture; its shape is the photo's.
    """
    from grs_agents.views.rays import paint
    from grs_agents.views.stage import Props, Stage

    stage = Stage(Props(objects, background=background, textures=False), library)
    scale = float(camera["width"]) / width
    height = round(float(camera["height"]) / scale)
    x = ((np.arange(width) + 0.5) * scale - 0.5 - float(camera["cx"])) / float(camera["fx"])
    y = ((np.arange(height) + 0.5) * scale - 0.5 - float(camera["cy"])) / float(camera["fy"])
    rays = np.empty((height, width, 3))
    rays[..., 0], rays[..., 1], rays[..., 2] = x[None, :], y[:, None], 1.0
    pose = np.asarray(camera["T_robot_cam"], dtype=np.float64)
    return paint(stage.model, stage.data, np.ascontiguousarray(pose[:3, 3]), rays @ pose[:3, :3].T)
