"""Read a scene from a folder, a data set, an archive or a photo; what is wrong with it is refused by name."""

from grs_agents.scene.reading.camera import CameraFile, read_camera
from grs_agents.scene.reading.masks import read_masks
from grs_agents.scene.reading.photo import DepthEstimate, Estimator
from grs_agents.scene.reading.source import check_source, read_scene, scene_called, scene_name

__all__ = [
    "CameraFile",
    "DepthEstimate",
    "Estimator",
    "check_source",
    "read_camera",
    "read_masks",
    "read_scene",
    "scene_called",
    "scene_name",
]
