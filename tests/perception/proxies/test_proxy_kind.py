"""Which solid fits what was measured."""

import numpy as np

from grs_agents.base import Vec3
from grs_agents.perception.proxies import FreeColumns, MeasuredShape, add_unseen_side, choose_proxy_kind

SIZE: Vec3 = (0.12, 0.12, 0.08)
RNG = np.random.default_rng(0)


def on_sphere(count: int = 600) -> np.ndarray:
    """Points on an ellipsoid of SIZE."""
    points = RNG.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * np.array(SIZE) / 2


def on_box(count: int = 600) -> np.ndarray:
    """Points on a box of SIZE."""
    points = RNG.uniform(-1, 1, (count, 3))
    return points / np.abs(points).max(axis=1, keepdims=True) * np.array(SIZE) / 2


def stepped() -> MeasuredShape:
    """Two steps: the far half of SIZE is as high as it, the near one a third."""
    heights = np.full((12, 12), SIZE[2])
    heights[:6] = SIZE[2] / 3
    points = RNG.uniform(-0.5, 0.5, (900, 3)) * SIZE
    points[:, 2] = np.where(points[:, 0] < 0, -SIZE[2] / 6, SIZE[2] / 2)
    return MeasuredShape(points, FreeColumns.from_heights(heights))


def test_the_kind_follows_the_points() -> None:
    assert choose_proxy_kind(MeasuredShape(on_box()), SIZE, around=False, hollow=False) == "box"
    assert choose_proxy_kind(MeasuredShape(on_sphere()), SIZE, around=True, hollow=False) == "hull"
    assert choose_proxy_kind(MeasuredShape(on_box()), SIZE, around=True, hollow=True) == "bowl"
    assert choose_proxy_kind(MeasuredShape(on_box()), SIZE, around=False, hollow=True) == "open box"
    assert choose_proxy_kind(MeasuredShape(on_box(20)), SIZE, around=True, hollow=False) == "cylinder"


def test_what_is_stepped_is_a_relief_even_where_it_was_taken_for_hollow() -> None:
    assert choose_proxy_kind(stepped(), SIZE, around=False, hollow=False) == "height blocks"
    assert choose_proxy_kind(stepped(), SIZE, around=False, hollow=True) == "height blocks"
    assert choose_proxy_kind(stepped(), SIZE, around=True, hollow=True) == "bowl"


def test_what_stands_in_the_air_that_the_photo_shows_is_no_box() -> None:
    heights = np.full((12, 12), SIZE[2])
    heights[4:, 4:] = 0.0
    seen = on_box()
    seen = seen[(seen[:, :2] < -SIZE[0] / 6).any(axis=1)]
    lower = MeasuredShape(seen, FreeColumns.from_heights(heights))
    full = MeasuredShape(on_box(), FreeColumns.from_heights(np.full((12, 12), SIZE[2])))
    assert choose_proxy_kind(MeasuredShape(seen), SIZE, around=False, hollow=False) == "box"
    assert choose_proxy_kind(lower, SIZE, around=False, hollow=False) == "height blocks"
    assert choose_proxy_kind(full, SIZE, around=False, hollow=False) == "box"


def test_a_top_that_is_flat_but_for_noise_is_flat() -> None:
    points = on_sphere()
    points[:, 2] = np.minimum(points[:, 2], SIZE[2] / 4)
    noisy = points + (points[:, 2:] == SIZE[2] / 4) * RNG.uniform(-0.003, 0.0, (len(points), 1)) * (0, 0, 1)
    size = (SIZE[0], SIZE[1], SIZE[2] / 2)
    noisy[:, 2] -= noisy[:, 2].max() - size[2] / 2
    whole = add_unseen_side(noisy, size)
    top = whole[whole[:, 2] > size[2] / 2 - 1e-6]
    assert len(top) > 20 and np.ptp(top[:, 0]) > 0.5 * size[0]
