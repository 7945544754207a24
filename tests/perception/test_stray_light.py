"""The light of a robot near the camera, in the depth of the table beside it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from grs_agents.perception.depth_quality import measure_stray_light, remove_stray_light
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import RGBDFrame
from tests.perception import room

ARM = ((-0.12, -0.05, 0.38), (0.1, 0.06, 0.46))
"""Lowest and highest corners of a link near the camera, m."""


def photo_beside_arm(share: float, width: float, measured: bool) -> tuple[RGBDFrame, np.ndarray, np.ndarray]:
    """A table beside an arm, of which so much of the light is scattered so widely (pixels); the arm's own depth; and
    where the table is near the arm. The arm may be too bright to be ``measured``."""
    camera = room.camera()
    frame, _, owner = room.photo(camera, noise=0.001, boxes=np.concatenate([room.BOXES, [ARM]]))
    arm = np.where(owner == len(room.BOXES), frame.depth, np.inf)
    on_arm = np.isfinite(arm)
    light = np.where(on_arm, 0.8, np.where(owner == 0, 0.25, 0.4)) / np.maximum(frame.depth, 0.2) ** 2
    light = np.where(owner < 0, 0, light)
    glow, mixed = (cv2.GaussianBlur(one, (0, 0), width) for one in (light, light * frame.depth))
    depth = (light * frame.depth + share * mixed) / np.maximum(light + share * glow, 1e-9)
    depth = np.where((owner < 0) | on_arm & (not measured), 0, depth).astype(np.float32)
    rgb = np.where(on_arm[..., None], 200, np.where((owner == 0)[..., None], 70, frame.rgb)).astype(np.uint8)
    away = cv2.distanceTransform((~on_arm).astype(np.uint8), cv2.DIST_L2, 5)
    return replace(frame, rgb=rgb, depth=depth), arm, (owner == 0) & (away > 2) & (away < 25)


@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize(("share", "width"), [(0.012, 14.0), (0.025, 8.0)])
def test_the_table_beside_a_bright_arm_comes_to_lie_in_its_plane(share: float, width: float, measured: bool) -> None:
    frame, arm, beside = photo_beside_arm(share, width, measured)
    table = find_table(frame, np.random.default_rng(0))
    stray = measure_stray_light(frame, table, arm)
    assert stray is not None
    assert 0.5 * width < stray.width < 2 * width
    clear = remove_stray_light(frame, arm, stray)
    lifted, left = (float(np.nanmean(robot_frame_point_map(one, table)[beside, 2])) for one in (frame, clear))
    assert lifted > 0.006
    assert abs(left) < 0.3 * lifted
    assert f"{stray.width:.0f} pixels" in clear.notes[-1]
    np.testing.assert_array_equal(clear.depth > 0, frame.depth > 0)


def test_depth_that_no_light_lifts_is_left_alone() -> None:
    frame, arm, _ = photo_beside_arm(0.0, 14.0, True)
    table = find_table(frame, np.random.default_rng(0))
    assert measure_stray_light(frame, table, arm) is None
    lit, _, _ = photo_beside_arm(0.012, 14.0, True)
    assert measure_stray_light(lit, table, np.full(arm.shape, np.inf)) is None, "no robot is known"
