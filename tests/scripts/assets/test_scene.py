"""The sample scene is what it says it is."""

import json

import numpy as np
import pytest

from grs_agents import content
from grs_agents.library import Library
from scripts.assets.scene import GROCERIES
from tests.pictures import read_picture

FOLDER = content.path("assets", "scenes") / "groceries"


def test_everything_is_within_reach_and_apart() -> None:
    library = Library()
    discs = [(np.array([thing.x, thing.y]), library.asset(thing.asset).size, thing) for thing in GROCERIES]
    for place, _, _ in discs:
        assert 0.3 <= place[0] <= 0.7
        assert -0.4 <= place[1] <= 0.4
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    for place, (x, y, _), thing in discs:
        c, s = abs(np.cos(thing.yaw)), abs(np.sin(thing.yaw))
        half = np.array([c * x + s * y, s * x + c * y]) / 2
        boxes.append((place - half, place + half))
    for index, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:index]:
            assert max(np.maximum(low - other_high, other_low - high)) > 0.04


def test_its_files_agree() -> None:
    camera = json.loads((FOLDER / "camera.json").read_text())
    truth = json.loads((FOLDER / "truth.json").read_text())["objects"]
    rgb = read_picture(FOLDER / "rgb.png")
    depth = read_picture(FOLDER / "depth.png")
    labels = read_picture(FOLDER / "labels.png")
    assert rgb.shape == (480, 640, 3)
    assert (rgb.dtype, depth.dtype, labels.dtype) == (np.uint8, np.uint16, np.uint8)
    assert depth.shape == labels.shape == (camera["height"], camera["width"])
    assert 0.005 < (depth == 0).mean() < 0.1
    matrix = np.array(camera["T_robot_cam"])
    rows, columns = np.nonzero(depth)
    z = depth[rows, columns] * camera["depth_scale"]
    local = np.stack([(columns - camera["cx"]) / camera["fx"] * z, (rows - camera["cy"]) / camera["fy"] * z, z], 1)
    points, owner = local @ matrix[:3, :3].T + matrix[:3, 3], labels[rows, columns]
    table = points[(owner == 0) & (points[:, 2] > -0.1)]
    assert np.median(table[:, 2]) == pytest.approx(0, abs=0.003)
    library = Library()
    for thing in truth:
        own = points[owner == thing["id"]]
        assert len(own) > 300
        assert np.percentile(own[:, 2], 98) == pytest.approx(library.asset(thing["asset"]).size[2], abs=0.012)
        assert np.linalg.norm(np.median(own[:, :2], axis=0) - thing["position"][:2]) < 0.14
