"""A built asset writes its files."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from evals.synthesis.built_asset import BuiltAsset, png
from grs_agents.library.asset import Asset


def test_files_are_written_below_the_root(tmp_path: Path) -> None:
    asset = Asset(
        name="a/b.urdf", kind="b", category="box", size=(1, 1, 1), mass=1, friction=1, color="red", description="b"
    )
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    BuiltAsset(asset, "<robot/>", {"a/m.obj": "v"}, {"a/t.png": image}).write(tmp_path)
    assert (tmp_path / "a/b.urdf").read_text() == "<robot/>"
    assert (tmp_path / "a/m.obj").read_text() == "v"
    assert (cv2.imread(str(tmp_path / "a/t.png")) == image).all()


def test_depth_keeps_sixteen_bits() -> None:
    depth = np.array([[0, 1000], [40000, 65535]], dtype=np.uint16)
    assert (cv2.imdecode(np.frombuffer(png(depth), np.uint8), cv2.IMREAD_UNCHANGED) == depth).all()


def test_an_empty_image_is_refused() -> None:
    with pytest.raises((ValueError, cv2.error)):
        png(np.zeros((0, 0, 3), np.uint8))
