"""Depth, intrinsics and poses as people get them wrong: read where the meaning is sure, else the cause is named."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.perception.reading.foreign_scene import read_foreign_scene
from grs_agents.perception.table_finding import find_table
from tests.cases.public_cases import copy_case
from tests.cli.command import grs


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cam_depth_scale_1000", "0.001 (1 / 1000) it would be 1.067 m"),
        ("depth_intrinsics_of_double_size", "the centre of a picture of 1280x960"),
        ("depth_norm_principal_point", "shares of the picture, not pixels"),
        ("depth_zbuffer", "z-buffer"),
        ("pose_quaternion_wrong_order", "T_robot_cam probably is made of a quaternion wxyz that was read as xyzw"),
    ],
)
def test_a_mistake_is_named_in_one_line(tmp_path: Path, name: str, words: str) -> None:
    done = grs("scene", str(copy_case(name, tmp_path)), "--out", "out", "-q", folder=tmp_path)
    assert (done.returncode, len(done.stderr.strip().splitlines())) == (2, 1), done.stderr
    assert words in done.stderr


def test_distance_along_the_ray_is_converted_and_told(tmp_path: Path) -> None:
    frame = read_foreign_scene(copy_case("depth_ray_distance", tmp_path))
    assert any("distance along the ray" in note for note in frame.notes)
    assert find_table(frame, np.random.default_rng(0)).inliers > 0.1


def test_three_equal_channels_of_16_bits_are_depth(tmp_path: Path) -> None:
    frame = read_foreign_scene(copy_case("depth_three_channels", tmp_path))
    assert find_table(frame, np.random.default_rng(0)).inliers > 0.1
