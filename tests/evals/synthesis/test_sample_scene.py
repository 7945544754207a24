"""The sample scene is data: its files agree with one another and with what the library's assets look like today."""

from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import LabelledScene, read_labelled
from evals.synthesis.drawing import PerfectImage, draw_scene
from evals.synthesis.scenery import random_scenery
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles
from grs_agents.library.shapes import Placement
from tests.pictures import read_picture


@pytest.fixture(scope="module")
def scene(sample_scene: Path) -> LabelledScene:
    """The sample scene with its truth."""
    return read_labelled(sample_scene)


@pytest.fixture(scope="module")
def drawn(scene: LabelledScene) -> PerfectImage:
    """What the scene's camera sees of the assets of its truth."""
    posed: list[tuple[str, Placement]] = []
    for one in scene.truth.objects:
        assert one.position is not None and one.rotation is not None
        posed.append((one.asset, (one.position, one.rotation)))
    triangles = build_posed_triangles(posed, Library())
    return draw_scene(triangles, random_scenery(np.random.default_rng(0)), scene.frame.camera)


def test_everything_is_within_reach_and_apart(scene: LabelledScene) -> None:
    library = Library()
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    for one in scene.truth.objects:
        assert one.position is not None and one.yaw is not None
        place, (x, y, _), yaw = np.array(one.position[:2]), library.asset(one.asset).size, one.yaw
        assert 0.3 <= place[0] <= 0.7
        assert -0.4 <= place[1] <= 0.4
        c, s = abs(np.cos(yaw)), abs(np.sin(yaw))
        half = np.array([c * x + s * y, s * x + c * y]) / 2
        boxes.append((place - half, place + half))
    for index, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:index]:
            assert max(np.maximum(low - other_high, other_low - high)) > 0.04


def test_its_labels_and_depth_are_those_of_the_assets(scene: LabelledScene, drawn: PerfectImage) -> None:
    assert (drawn.labels == scene.labels).mean() > 0.999
    for one in scene.truth.objects:
        mine, shown = drawn.labels == one.id, scene.labels == one.id
        assert (mine & shown).sum() > 0.97 * (mine | shown).sum()
    known = scene.frame.depth > 0
    error = np.abs(scene.frame.depth - drawn.depth)[known & (drawn.labels > 0)]
    assert np.median(error) < 0.004
    assert 0.005 < (~known).mean() < 0.1


def test_its_colours_are_those_of_the_assets(scene: LabelledScene, drawn: PerfectImage, sample_scene: Path) -> None:
    photo = read_picture(sample_scene / "rgb.png")[:, :, ::-1]
    for one in scene.truth.objects:
        mine = (drawn.labels == one.id) & (scene.labels == one.id)
        shown, expected = photo[mine].mean(axis=0), drawn.rgb[mine].mean(axis=0)
        cosine = shown @ expected / (np.linalg.norm(shown) * np.linalg.norm(expected))
        assert cosine > 0.95, one.asset


def test_the_table_is_at_zero(scene: LabelledScene) -> None:
    pose = np.array(scene.frame.camera.T_robot_cam)
    points = (
        scene.frame.camera_frame_point_map()[(scene.labels == 0) & (scene.frame.depth > 0)] @ pose[:3, :3].T
        + pose[:3, 3]
    )
    assert np.median(points[points[:, 2] > -0.1][:, 2]) == pytest.approx(0, abs=0.003)
