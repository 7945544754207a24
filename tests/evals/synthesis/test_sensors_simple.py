"""The noise of a stereo camera."""

import numpy as np

from evals.synthesis.sensors.simple import noisy_rgb, stereo_depth


def test_depth_is_near_the_truth_quantised_and_lost_at_edges() -> None:
    depth = np.full((120, 160), 1.2)
    depth[40:80, 60:100] = 0.9
    measured = stereo_depth(depth, 600.0, np.random.default_rng(1))
    seen = measured > 0
    assert measured.dtype == np.uint16
    error = np.abs(measured / 1000 - depth)[seen]
    assert np.median(error) < 0.004
    assert error.max() < 0.03
    assert len(np.unique(measured)) < 60
    edge = np.zeros_like(seen)
    edge[39:41, 60:100] = True
    assert (~seen)[edge].mean() > 0.5
    assert (~seen).mean() < 0.1


def test_colours_keep_their_mean() -> None:
    picture = np.full((60, 60, 3), 0.5)
    noisy = noisy_rgb(picture, np.random.default_rng(0))
    assert abs(noisy.mean() / 255 - 0.5) < 0.01
    assert 0.5 < noisy.std() < 5
