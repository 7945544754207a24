"""Read a scene from a folder, a data set, an archive or a photo; what is wrong with it is refused by InputError."""

from grs_agents.perception.reading.camera import CameraFile, read_camera
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.photo_without_depth import DepthEstimate, Estimator
from grs_agents.perception.reading.source import check_source, read_scene, resolve_scene, scene_name

__all__ = [
    "CameraFile",
    "DepthEstimate",
    "Estimator",
    "check_source",
    "read_camera",
    "read_masks",
    "read_scene",
    "resolve_scene",
    "scene_name",
]
