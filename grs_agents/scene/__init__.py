"""Scene comprehension, as far as geometry goes: frame, table, segments, boxes in the robot frame."""

from grs_agents.scene.air import shown_free
from grs_agents.scene.background import Background, reconstruct
from grs_agents.scene.candidates import candidates_of, place_asset, place_robot
from grs_agents.scene.clipping import Claim, clipped
from grs_agents.scene.explaining import Shell, explained, shell_of
from grs_agents.scene.frame import Camera, Image, Mask, RGBDFrame
from grs_agents.scene.leftover import Later, found_later
from grs_agents.scene.likeness import Deviation, aligned, certain, deviation, upright_of
from grs_agents.scene.pictures import add_candidates, annotate, load_frame, load_mask, save_candidates, save_frame
from grs_agents.scene.proposals import Proposal, segment_proposed
from grs_agents.scene.reading.camera import CameraFile, read_camera
from grs_agents.scene.reading.masks import read_masks
from grs_agents.scene.reading.photo import DepthEstimate, Estimator
from grs_agents.scene.reading.source import check_source, read_scene, scene_called, scene_name
from grs_agents.scene.registration import Registered, cost_of, register
from grs_agents.scene.relations import Body, body_of, relations
from grs_agents.scene.segmentation import segment
from grs_agents.scene.surroundings import Surroundings
from grs_agents.scene.table import doubts, find_table
from grs_agents.scene.types import (
    Aabb,
    Candidate,
    CandidateRecord,
    DroppedCandidate,
    MatchEvidence,
    Relation,
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
