"""What is seen over an edge: the inside of a hollow thing closes at the edge's ends, a thing behind does not."""

import numpy as np
import pytest

from grs_agents.perception.segmentation.part_merging import OcclusionEdges
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from tests.perception.conftest import Rendered, Thing, render

NEAR, FAR = 1, 2


@pytest.fixture(scope="module")
def bowl() -> tuple[Rendered, np.ndarray]:
    """A bowl of which the outside of the near wall and the inside are two parts."""
    scene = render([Thing("cylinder", (0.5, 0.0), (0.16, 0.16, 0.07), wall=0.01)], noise=0.0, calibrated=True)
    points = robot_frame_point_map(scene.frame, find_table(scene.frame, np.random.default_rng(0)))
    outside = np.linalg.norm(points[..., :2] - (0.5, 0.0), axis=2) > 0.072
    labels = np.where(outside & (points[..., 0] < 0.5), NEAR, FAR).astype(np.int32)
    return scene, np.where(scene.labels == 1, labels, 0)


def _occlusion_edges(scene: Rendered, labels: np.ndarray) -> OcclusionEdges:
    return OcclusionEdges(labels, robot_frame_point_map(scene.frame, find_table(scene.frame, np.random.default_rng(0))))


def test_the_inside_of_a_bowl_closes_at_its_near_wall(bowl: tuple[Rendered, np.ndarray]) -> None:
    edges = _occlusion_edges(*bowl)
    assert edges.is_far_label_seen_over_edge(NEAR, FAR, 40)
    assert edges.reaches_rim_at_ends(NEAR, FAR, top=0.07)


def test_a_box_behind_a_box_does_not_close() -> None:
    boxes = (Thing("box", (0.4, 0.0), (0.08, 0.12, 0.1)), Thing("box", (0.55, 0.02), (0.08, 0.14, 0.1)))
    scene = render(boxes, noise=0.0, calibrated=True)
    edges = _occlusion_edges(scene, scene.labels)
    assert edges.is_far_label_seen_over_edge(NEAR, FAR, 40)
    assert not edges.reaches_rim_at_ends(NEAR, FAR, top=0.1)


def test_a_can_behind_a_box_of_its_height_stays_one_of_two() -> None:
    scene = render([Thing("box", (0.3, 0.0), (0.1, 0.15, 0.1)), Thing("cylinder", (0.5, 0.0), (0.08, 0.08, 0.1))])
    assert segment_objects_on_table(scene.frame, find_table(scene.frame, np.random.default_rng(0))).max() == 2


def test_a_renamed_part_keeps_its_edges(bowl: tuple[Rendered, np.ndarray]) -> None:
    edges = _occlusion_edges(*bowl)
    edges.relabel_part(NEAR, 7)
    assert edges.reaches_rim_at_ends(7, FAR, top=0.07)
    assert not edges.is_far_label_seen_over_edge(NEAR, FAR, 40)


@pytest.mark.parametrize("wall", [0.006, 0.01])
@pytest.mark.parametrize("size", [(0.15, 0.15, 0.07), (0.08, 0.08, 0.1)])
def test_bowls_and_mugs_are_one_segment(wall: float, size: tuple[float, float, float]) -> None:
    scene = render([Thing("cylinder", (0.45, 0.05), size, wall=wall)], noise=0.002, seed=3)
    labels = segment_objects_on_table(scene.frame, find_table(scene.frame, np.random.default_rng(0)))
    assert labels.max() == 1
    both = ((labels > 0) & (scene.labels > 0)).sum()
    assert both > 0.7 * ((labels > 0) | (scene.labels > 0)).sum()
