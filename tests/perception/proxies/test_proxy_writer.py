"""Proxies fitted to points: the measured size, and the photo as texture."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import Vec3
from grs_agents.library import Library
from grs_agents.perception.proxies import FreeColumns, MeasuredShape, ProxyKind, ProxyTexture, write_proxy

SIZE: Vec3 = (0.12, 0.12, 0.08)
RNG = np.random.default_rng(0)


def on_sphere(count: int = 600) -> np.ndarray:
    """Points on an ellipsoid of SIZE."""
    points = RNG.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * np.array(SIZE) / 2


@pytest.mark.parametrize("kind", ["box", "cylinder", "bowl", "open box", "hull", "height blocks"])
def test_each_kind_has_the_measured_size_and_the_photo(tmp_path: Path, kind: ProxyKind) -> None:
    image = np.full((8, 8, 3), (200, 30, 30), np.uint8)
    measured = MeasuredShape(on_sphere(), FreeColumns.from_heights(np.repeat([[0.08, 0.08, 0.03, 0.03]], 4, axis=0)))
    texture = ProxyTexture(image, lambda points: 0.5 + points[:, :2], np.array([0.6, 0.0, 0.8]))
    asset = write_proxy(tmp_path, "thing", kind, SIZE, (0.8, 0.1, 0.1), "a thing", measured, texture)
    library = Library(tmp_path)
    model = library.load_object_model(asset.name)
    assert model.size == pytest.approx(SIZE, rel=0.03)
    assert asset.hollow == (kind in ("bowl", "open box"))
    assert model.visuals[0].texture == "proxy/thing.png"
    assert library.mesh_or_texture_path("proxy/thing.png").is_file()
