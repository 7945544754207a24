"""Proxies fitted to points: the kind that fits, the measured size, and the photo as texture."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import Vec3
from grs_agents.library import Library, Look, fitted_kind, write_fitted_proxy
from grs_agents.library.proxy_fitted import Fitted

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


def test_the_kind_follows_the_points() -> None:
    assert fitted_kind(on_box(), SIZE, around=False, hollow=False) == "box"
    assert fitted_kind(on_sphere(), SIZE, around=True, hollow=False) == "hull"
    assert fitted_kind(on_box(), SIZE, around=True, hollow=True) == "bowl"
    assert fitted_kind(on_box(), SIZE, around=False, hollow=True) == "open box"


@pytest.mark.parametrize("kind", ["box", "cylinder", "bowl", "open box", "hull"])
def test_each_kind_has_the_measured_size_and_the_photo(tmp_path: Path, kind: Fitted) -> None:
    image = np.full((8, 8, 3), (200, 30, 30), np.uint8)
    look = Look(image, lambda points: 0.5 + points[:, :2], np.array([0.6, 0.0, 0.8]))
    asset = write_fitted_proxy(tmp_path, "thing", kind, on_sphere(), SIZE, (0.8, 0.1, 0.1), "a thing", look)
    library = Library(tmp_path)
    model = library.model(asset.name)
    assert model.size == pytest.approx(SIZE, rel=0.03)
    assert asset.hollow == (kind in ("bowl", "open box"))
    assert model.visuals[0].texture == "proxy/thing.png"
    assert library.mesh_path("proxy/thing.png").is_file()
