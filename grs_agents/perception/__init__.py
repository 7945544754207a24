"""Scene comprehension, as far as geometry goes: frame, table, segments, boxes in the robot frame."""

from grs_agents.perception.background import Background, reconstruct
from grs_agents.perception.pictures import add_candidates, annotate, load_frame, load_mask, save_candidates, save_frame
from grs_agents.perception.proxies.box_clipping import Claim, clipped
from grs_agents.perception.proxies.free_space_map import shown_free
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.reading.camera import CameraFile, read_camera
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.photo_without_depth import DepthEstimate, Estimator
from grs_agents.perception.reading.source import check_source, read_scene, scene_called, scene_name
from grs_agents.perception.registration.registration import Registered, cost_of, register
from grs_agents.perception.registration.residual_segments import Later, found_later
from grs_agents.perception.registration.size_check import Deviation, aligned, certain, deviation, upright_of
from grs_agents.perception.registration.surface_inliers import Shell, explained, shell_of
from grs_agents.perception.segmentation.candidates import candidates_of, place_asset, place_robot
from grs_agents.perception.segmentation.model_proposals import Proposal, segment_proposed
from grs_agents.perception.segmentation.segmentation import segment
from grs_agents.perception.settling.support_relations import Body, body_of, relations
from grs_agents.perception.table import doubts, find_table
from grs_agents.perception.types import (
    Aabb,
    Camera,
    Candidate,
    CandidateRecord,
    DroppedCandidate,
    Image,
    Mask,
    MatchEvidence,
    Relation,
    RGBDFrame,
    SceneDescription,
    SceneObject,
    Shown,
    TableFrame,
    TwinReport,
    UprightBox,
    read_description,
)

__all__ = [
    "Aabb",
    "Background",
    "Body",
    "Camera",
    "CameraFile",
    "Candidate",
    "CandidateRecord",
    "Claim",
    "DepthEstimate",
    "Deviation",
    "DroppedCandidate",
    "Estimator",
    "Image",
    "Later",
    "Mask",
    "MatchEvidence",
    "Proposal",
    "RGBDFrame",
    "Registered",
    "Relation",
    "SceneDescription",
    "SceneObject",
    "Shell",
    "Shown",
    "Surroundings",
    "TableFrame",
    "TwinReport",
    "UprightBox",
    "add_candidates",
    "aligned",
    "annotate",
    "body_of",
    "candidates_of",
    "certain",
    "check_source",
    "clipped",
    "cost_of",
    "deviation",
    "doubts",
    "explained",
    "find_table",
    "found_later",
    "load_frame",
    "load_mask",
    "place_asset",
    "place_robot",
    "read_camera",
    "read_description",
    "read_masks",
    "read_scene",
    "reconstruct",
    "register",
    "relations",
    "save_candidates",
    "save_frame",
    "scene_called",
    "scene_name",
    "segment",
    "segment_proposed",
    "shell_of",
    "shown_free",
    "upright_of",
]
