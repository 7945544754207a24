"""Scene comprehension, as far as geometry goes: frame, table, segments, boxes in the robot frame."""

from grs_agents.scene.background import Background, reconstruct
from grs_agents.scene.candidates import candidates_of, place_asset, place_robot
from grs_agents.scene.frame import Camera, Image, Mask, RGBDFrame
from grs_agents.scene.pictures import annotate, save_candidates, save_frame
from grs_agents.scene.proposals import Proposal, segment_proposed
from grs_agents.scene.reading import (
    DepthEstimate,
    Estimator,
    check_source,
    read_camera,
    read_masks,
    read_scene,
    scene_name,
)
from grs_agents.scene.segmentation import segment
from grs_agents.scene.table import find_table
from grs_agents.scene.types import (
    Aabb,
    Candidate,
    CandidateRecord,
    DroppedCandidate,
    SceneDescription,
    SceneObject,
    TableFrame,
    UprightBox,
    read_description,
)

__all__ = [
    "Aabb",
    "Background",
    "Camera",
    "Candidate",
    "CandidateRecord",
    "DepthEstimate",
    "DroppedCandidate",
    "Estimator",
    "Image",
    "Mask",
    "Proposal",
    "RGBDFrame",
    "SceneDescription",
    "SceneObject",
    "TableFrame",
    "UprightBox",
    "annotate",
    "candidates_of",
    "check_source",
    "find_table",
    "place_asset",
    "place_robot",
    "read_camera",
    "read_description",
    "read_masks",
    "read_scene",
    "reconstruct",
    "save_candidates",
    "save_frame",
    "scene_name",
    "segment",
    "segment_proposed",
]
