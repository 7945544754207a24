"""Scene comprehension, as far as geometry goes: frame, table, segments, boxes in the robot frame."""

from grs_agents.perception.background import Background, reconstruct
from grs_agents.perception.pictures import add_candidates, annotate, load_frame, load_mask, save_candidates, save_frame
from grs_agents.perception.proxies.box_clipping import EstimatedVolume, clip_boxes
from grs_agents.perception.proxies.free_space_grid import observed_free
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.reading.camera import CameraFile, read_camera
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.photo_without_depth import DepthEstimate, Estimator
from grs_agents.perception.reading.source import check_source, read_scene, resolve_scene, scene_name
from grs_agents.perception.registration.registration import Registered, cost_of, register
from grs_agents.perception.registration.residual_segments import (
    ResidualCandidates,
    residual_candidates,
    surface_inliers,
)
from grs_agents.perception.registration.scene_registration import add_residual_candidates, pose_fields, register_objects
from grs_agents.perception.registration.size_check import Deviation, aligned, is_certain, size_deviation, upright_of
from grs_agents.perception.segmentation.candidates import candidates_of, place_asset, place_robot
from grs_agents.perception.segmentation.model_proposals import Proposal, segment_proposed
from grs_agents.perception.segmentation.segmentation import segment
from grs_agents.perception.settling.support_relations import body_of, relations
from grs_agents.perception.surfaces import asset_surface_at
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
    "Camera",
    "CameraFile",
    "Candidate",
    "CandidateRecord",
    "DepthEstimate",
    "Deviation",
    "DroppedCandidate",
    "EstimatedVolume",
    "Estimator",
    "Image",
    "Mask",
    "MatchEvidence",
    "Proposal",
    "RGBDFrame",
    "Registered",
    "Relation",
    "ResidualCandidates",
    "SceneDescription",
    "SceneObject",
    "Shown",
    "Surroundings",
    "TableFrame",
    "TwinReport",
    "UprightBox",
    "add_candidates",
    "add_residual_candidates",
    "aligned",
    "annotate",
    "asset_surface_at",
    "body_of",
    "candidates_of",
    "check_source",
    "clip_boxes",
    "cost_of",
    "doubts",
    "find_table",
    "is_certain",
    "load_frame",
    "load_mask",
    "observed_free",
    "place_asset",
    "place_robot",
    "pose_fields",
    "read_camera",
    "read_description",
    "read_masks",
    "read_scene",
    "reconstruct",
    "register",
    "register_objects",
    "relations",
    "residual_candidates",
    "resolve_scene",
    "save_candidates",
    "save_frame",
    "scene_name",
    "segment",
    "segment_proposed",
    "size_deviation",
    "surface_inliers",
    "upright_of",
]
