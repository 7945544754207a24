"""Depth cameras: how much their noise spreads, where they see nothing, and that a plain wall stays where it is."""

from collections.abc import Callable

import numpy as np
import pytest

from evals.synthesis import SENSORS, SensorKind
from evals.synthesis.drawing import PerfectImage
from evals.synthesis.sensors import stereo_depth, structured_light_depth, time_of_flight_depth
from evals.synthesis.sensors.common import noisy_rgb, occluded_from_second_eye, smooth_noise
from grs_agents.perception.types import Camera

SHAPE = (120, 160)
CAMERA = Camera(fx=525, fy=525, cx=79.5, cy=59.5, width=160, height=120, depth_scale=0.001)


def wall(
    depth: float | np.ndarray = 1.0, albedo: float = 0.6, cosine: float = 1.0, shiny: bool = False
) -> PerfectImage:
    """A wall with print on it, or several."""
    texture = np.random.default_rng(7).uniform(-0.1, 0.1, SHAPE)
    return PerfectImage(
        rgb=np.repeat((albedo + texture)[..., None], 3, axis=2),
        depth=np.broadcast_to(np.asarray(depth, np.float64), SHAPE).copy(),
        labels=np.zeros(SHAPE, np.int32),
        cosine=np.full(SHAPE, cosine),
        albedo=np.full(SHAPE, albedo),
        shiny=np.full(SHAPE, shiny),
    )


def step(near: float = 0.8, far: float = 1.2) -> np.ndarray:
    """A box in the middle of the picture before a wall."""
    depth = np.full(SHAPE, far)
    depth[30:90, 60:110] = near
    return depth


def spread(sensor: Callable[..., np.ndarray], seen: PerfectImage, seed: int = 0) -> float:
    """The deviation of the measured depth, m."""
    measured = sensor(seen, CAMERA, np.random.default_rng(seed))
    return float((measured - seen.depth)[measured > 0].std())


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("distance", [0.6, 1.0, 1.8])
def test_a_wall_is_seen_where_it_is(name: SensorKind, distance: float) -> None:
    measured = SENSORS[name](wall(distance), CAMERA, np.random.default_rng(1))
    assert (measured > 0).mean() > 0.95
    assert np.median(measured[measured > 0]) == pytest.approx(distance, abs=0.003 + 0.004 * distance**2)


@pytest.mark.parametrize("name", SENSORS)
def test_the_same_seed_makes_the_same_noise(name: SensorKind) -> None:
    one, same, other = (SENSORS[name](wall(step()), CAMERA, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_structured_light_spreads_with_the_square_of_the_distance_and_comes_in_steps() -> None:
    near, far = spread(structured_light_depth, wall(0.8)), spread(structured_light_depth, wall(1.6))
    assert far / near == pytest.approx(4, rel=0.2)
    quantised = 1.6**2 / (525 * 0.075) / 8 / np.sqrt(12)
    assert far == pytest.approx(np.hypot(1.6**2 / (525 * 0.075) / 16, quantised), rel=0.15)
    assert len(np.unique(structured_light_depth(wall(1.0), CAMERA, np.random.default_rng(0)))) < 12


def test_time_of_flight_spreads_more_on_what_is_dark() -> None:
    bright, dark = (
        spread(time_of_flight_depth, wall(1.0, albedo=0.5)),
        spread(time_of_flight_depth, wall(1.0, albedo=0.125)),
    )
    assert bright == pytest.approx(0.001, rel=0.1)
    assert dark == pytest.approx(0.002, rel=0.1)


def test_stereo_spreads_with_the_square_of_the_distance() -> None:
    near, far = spread(stereo_depth, wall(0.8)), spread(stereo_depth, wall(1.6))
    assert far / near == pytest.approx(4, rel=0.25)
    assert far == pytest.approx(0.08 * 1.6**2 / (525 * 0.05), rel=0.3)


@pytest.mark.parametrize("sensor", [structured_light_depth, time_of_flight_depth])
def test_nothing_is_measured_on_black(sensor: Callable[..., np.ndarray]) -> None:
    assert (sensor(wall(1.0, albedo=0.005), CAMERA, np.random.default_rng(0)) > 0).mean() < 0.05


@pytest.mark.parametrize("name", SENSORS)
def test_much_is_lost_at_grazing_angles_or_on_mirrors(name: SensorKind) -> None:
    grazing = SENSORS[name](wall(1.0, cosine=0.02), CAMERA, np.random.default_rng(0))
    mirror = SENSORS[name](wall(1.0, shiny=True), CAMERA, np.random.default_rng(0))
    assert (grazing > 0).mean() < 0.1
    assert (mirror > 0).mean() < 0.9


@pytest.mark.parametrize("sensor", [structured_light_depth, stereo_depth])
def test_a_shadow_falls_on_one_side_of_what_is_near(sensor: Callable[..., np.ndarray]) -> None:
    measured = sensor(wall(step()), CAMERA, np.random.default_rng(0))
    left, right = measured[35:85, 54:58], measured[35:85, 113:117]
    assert (left == 0).mean() > 0.9
    assert (right == 0).mean() < 0.2


def test_a_plain_wall_gives_stereo_holes_and_fat_outlines() -> None:
    plain = wall(step())
    plain = PerfectImage(np.full((*SHAPE, 3), 0.5), plain.depth, plain.labels, plain.cosine, plain.albedo, plain.shiny)
    printed = stereo_depth(wall(step()), CAMERA, np.random.default_rng(0))
    measured = stereo_depth(plain, CAMERA, np.random.default_rng(0))
    assert (measured == 0).sum() > (printed == 0).sum() + 100
    beside = measured[35:85, 110:112]
    assert (beside[beside > 0] < 1.0).mean() > 0.3


def test_time_of_flight_mixes_depths_at_outlines() -> None:
    measured = time_of_flight_depth(wall(step()), CAMERA, np.random.default_rng(0))
    flying = (measured > 0.83) & (measured < 1.17)
    assert 0 < flying.sum() < 300
    assert not flying[40:80, 70:100].any()


def test_a_second_eye_sees_all_of_a_wall_and_not_behind_a_box() -> None:
    assert not occluded_from_second_eye(np.full(SHAPE, 20.0)).any()
    hidden = occluded_from_second_eye(25 / step())
    assert hidden[60].sum() == pytest.approx(25 / 0.8 - 25 / 1.2, abs=3)


@pytest.mark.parametrize("width", [1.0, 2.5, 4.0])
def test_smooth_noise_has_unit_deviation(width: float) -> None:
    noise = smooth_noise((400, 400), width, np.random.default_rng(0))
    assert noise.std() == pytest.approx(1, rel=0.15)


def test_colours_keep_their_mean() -> None:
    noisy = noisy_rgb(np.full((60, 60, 3), 0.5), np.random.default_rng(0))
    assert abs(noisy.mean() / 255 - 0.5) < 0.01
    assert 0.5 < noisy.std() < 5
