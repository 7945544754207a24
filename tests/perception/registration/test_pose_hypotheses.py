"""Where a registration begins."""

import math

import numpy as np

from grs_agents.base.geometry.transforms import pose_matrix
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion, quaternion_from_rpy
from grs_agents.perception.asset_surfaces import RegistrationCloud
from grs_agents.perception.registration.pose_cost import sample_observed_points
from grs_agents.perception.registration.registration import estimate_leaning_axes, propose_shifted_poses
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import Mask
from tests.perception.settling.photo import photo_of

LIBRARY = Library()
ASSET = "HOPE/Raisins.urdf"


def test_a_box_that_leans_is_told_by_its_faces() -> None:
    turn = quaternion_from_rpy(0.0, math.radians(30), 0.5)
    frame, table, mask = photo_of([PlacedObject(ASSET, ((0.5, 0.0, 0.1), turn))], LIBRARY)
    seen = sample_observed_points(frame, table, mask)
    axes = estimate_leaning_axes(seen, RegistrationCloud(seen.points).normals)
    assert axes is not None
    alike = np.abs(axes.T @ matrix_from_quaternion(turn)).max(axis=1)
    assert (alike > math.cos(math.radians(6))).all()


def test_what_stands_upright_does_not_lean() -> None:
    frame, table, mask = photo_of([PlacedObject(ASSET, ((0.5, 0.0, 0.062), (0.0, 0.0, 0.0, 1.0)))], LIBRARY)
    seen = sample_observed_points(frame, table, mask)
    assert estimate_leaning_axes(seen, RegistrationCloud(seen.points).normals) is None


def test_a_half_that_is_seen_may_be_either_end() -> None:
    frame, table, mask = photo_of([PlacedObject(ASSET, ((0.5, 0.0, 0.062), (0.0, 0.0, 0.0, 1.0)))], LIBRARY)
    half: Mask = mask & (np.arange(mask.shape[1]) < np.median(np.nonzero(mask)[1]))
    seen = sample_observed_points(frame, table, half)
    extents = np.array(LIBRARY.asset(ASSET).size) / 2
    middle = seen.points.mean(axis=0)
    poses = propose_shifted_poses(pose_matrix(np.eye(3), np.array([middle[0], middle[1], 0.062]))[None], extents, seen)
    assert len(poses) >= 2
    assert min(abs(pose[1, 3]) for pose in poses) < 0.015
