"""Smooth patches and their borders."""

import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.patch_cutting import (
    compute_concavity_map,
    cut_smooth_patches,
    grow_labels,
    join_enclosed_fragments,
    smooth_frame_depth,
)
from grs_agents.perception.types import RGBDFrame
from tests.perception.conftest import Rendered


def _pure(labels: np.ndarray, truth: np.ndarray) -> float:
    """The share of the patches' pixels that lie on the thing on which most of their patch lies."""
    good = sum(np.bincount(truth[labels == label]).max() for label in np.unique(labels) if label)
    return float(good / (labels > 0).sum())


def test_a_patch_lies_on_one_thing(rendered: Rendered, stacked: Rendered) -> None:
    for scene in (rendered, stacked):
        smooth = smooth_frame_depth(scene.frame)
        labels = cut_smooth_patches(smooth, scene.labels > 0, compute_concavity_map(smooth, scene.labels > 0))
        assert _pure(labels, scene.labels) > 0.95


def test_a_convex_thing_is_one_patch(rendered: Rendered) -> None:
    smooth = smooth_frame_depth(rendered.frame)
    labels = cut_smooth_patches(smooth, rendered.labels > 0, compute_concavity_map(smooth, rendered.labels > 0))
    for thing in (1, 2, 4):
        areas = np.bincount(labels[rendered.labels == thing])
        assert areas[1:].max() > 0.9 * areas.sum()


def test_a_plane_does_not_bend_and_a_foot_does(rendered: Rendered) -> None:
    bend = compute_concavity_map(smooth_frame_depth(rendered.frame), rendered.labels > 0)
    foot = (rendered.labels > 0)[:-1] & (rendered.labels == 0)[1:]
    assert float(np.median(bend[:-1][foot])) > 0.1
    assert float(np.percentile(bend[250:, 200:280], 95)) < 0.1


def test_a_picture_too_small_for_a_chord_has_no_bends(rendered: Rendered) -> None:
    camera = rendered.frame.camera.model_copy(update={"width": 4, "height": 3})
    small = RGBDFrame(np.zeros((3, 4, 3), np.uint8), np.ones((3, 4), np.float32), camera, rendered.frame.source)
    assert not compute_concavity_map(small, np.ones((3, 4), np.bool_)).any()


def test_growing_stops_at_a_jump_and_at_the_foreground() -> None:
    depth = np.ones((5, 9), np.float32)
    depth[:, 6:] = 1.5
    labels = np.zeros((5, 9), np.int32)
    labels[2, 2] = 1
    result = grow_labels(labels, np.arange(9)[None] * np.ones((5, 1)) > 0, depth)
    assert (result[:, 1:6] == 1).all()
    assert not result[:, 0].any()
    assert not result[:, 6:].any()


def test_a_fragment_belongs_to_what_encloses_it_but_not_over_a_crease_or_along_one_side() -> None:
    """A 6 x 6 piece in a face of 40 x 40, and one beside it: borders of 24 and of 6 pixels."""
    config = DEFAULT.segmentation.patches
    labels = np.ones((40, 46), np.int32)
    labels[:, 40:] = 0
    labels[10:16, 10:16], labels[10:16, 40:] = 2, 3
    length = np.zeros((4, 4))
    length[1, 2] = length[2, 1] = 24
    length[1, 3] = length[3, 1] = 6
    for strength, count in ((config.fold - 0.01, 2), (config.fold + 0.01, 3)):
        joined = join_enclosed_fragments(labels, length, strength * length, config)
        assert len(np.unique(joined[labels > 0])) == count
        assert (joined[labels == 3] != joined[0, 0]).all(), "it touches one side of the face"
        assert not joined[labels == 0].any()
