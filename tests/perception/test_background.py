"""What is left of a photo without objects and table: near the truth, away from objects and arm, few boxes."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import ConfigError
from grs_agents.perception.background_reconstruction import Background, cover_points_with_boxes, reconstruct_background
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Aabb
from tests.perception import room
from tests.perception.room import Floats

NO_ARM: Floats = np.zeros((0, 4))
NEAR = 0.02


def to_triangles(points: Floats, corners: Floats) -> Floats:
    """(N,) distances of (N, 3) points to the nearest of (F, 3, 3) triangles, all densely sampled."""
    steps = np.linspace(0, 1, 9)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    a, b = a[a + b <= 1], b[a + b <= 1]
    weights = np.stack([1 - a - b, a, b], axis=1)
    samples = np.einsum("wk,fkx->fwx", weights, corners).reshape(-1, 3)
    cells = np.unique(np.round(samples / 0.004).astype(np.int64), axis=0) * 0.004
    return np.concatenate([np.sqrt(((part[:, None] - cells) ** 2).sum(axis=2).min(axis=1)) for part in chunks(points)])


def chunks(points: Floats) -> list[Floats]:
    """The points by fifty."""
    return np.array_split(points, max(1, len(points) // 50))


def to_boxes(points: Floats, boxes: Floats) -> Floats:
    """(N,) distances of points to the nearest of (B, 2, 3) boxes."""
    off = np.maximum(np.maximum(boxes[None, :, 0] - points[:, None], points[:, None] - boxes[None, :, 1]), 0)
    return np.linalg.norm(off, axis=2).min(axis=1)


def made(yaw: float, noise: float, arm: Floats = NO_ARM, voxel: float = 0.015) -> tuple[Background, Floats]:
    """The background of the room, and a sample (N, 3) of the true points of it that the photo shows."""
    frame, points, owner = room.photo(room.camera(yaw, 480, 360), noise)
    table = find_table(frame, np.random.default_rng(0))
    around = [aabb(*room.BOXES[number]) for number in room.THINGS]
    found = reconstruct_background(frame, table, np.isin(owner, room.THINGS), around, arm, voxel)
    assert found is not None
    return found, points[np.isin(owner, room.ROOM)][::97]


def aabb(low: Floats, high: Floats) -> Aabb:
    """Two corners as a box."""
    (a, b, c), (x, y, z) = low.tolist(), high.tolist()
    return Aabb(low=(a, b, c), high=(x, y, z))


@pytest.mark.parametrize(("yaw", "noise"), [(0.0, 0.0), (0.4, 0.002)])
def test_the_surface_is_near_what_is_seen(yaw: float, noise: float) -> None:
    found, true = made(yaw, noise)
    surface = to_triangles(true, found.mesh.vertices[found.mesh.faces])
    assert (surface <= NEAR).mean() >= 0.9
    assert (to_boxes(true, found.boxes) <= NEAR).mean() >= 0.9
    real = to_boxes(found.mesh.vertices, room.BOXES[list(room.ROOM)])
    assert (real <= NEAR).mean() >= 0.97
    assert 0 < len(found.boxes) <= DEFAULT.background.most_boxes
    assert len(found.mesh.faces) < 10_000


def test_it_keeps_away_from_objects_and_arm() -> None:
    arm = np.array([[1.2, -1.0, 0.2, 0.2]])
    found, _ = made(0.0, 0.0, arm)
    for number in room.THINGS:
        low, high = room.BOXES[number]
        meets = (found.boxes[:, 0] < high + DEFAULT.background.clear) & (
            found.boxes[:, 1] > low - DEFAULT.background.clear
        )
        assert not meets.all(axis=1).any()
    assert to_boxes(arm[:, :3], found.boxes)[0] >= arm[0, 3] + DEFAULT.background.clear - 1e-9
    assert np.linalg.norm(found.mesh.vertices - arm[0, :3], axis=1).min() > arm[0, 3]


def test_a_table_alone_has_no_background() -> None:
    bare = np.array([((-3.0, -3.0, -0.05), (6.0, 3.0, 0.0))])
    frame, _, owner = room.photo(room.camera(0.0, 160, 120), boxes=bare)
    table = find_table(frame, np.random.default_rng(0))
    assert reconstruct_background(frame, table, owner > 0, [], NO_ARM, 0.02) is None


def test_without_scikit_image_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    frame, _, owner = room.photo(room.camera(0.0, 160, 120))
    table = find_table(frame, np.random.default_rng(0))
    with pytest.raises(ConfigError, match=r"grs-agents\[background\]"):
        reconstruct_background(frame, table, owner > 3, [], NO_ARM, 0.02)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.sampled_from([0.01, 0.05, 0.3]))
def test_few_boxes_hold_all_points(seed: int, count: int, cell: float) -> None:
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    boxes = cover_points_with_boxes(points, cell)
    assert 0 < len(boxes) <= DEFAULT.background.most_boxes
    assert to_boxes(points, boxes).max() < 1e-9
    assert (boxes[:, 0] < boxes[:, 1]).all()


def test_a_wall_along_an_axis_is_one_thin_box() -> None:
    y, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 1, 0.02), np.arange(0, 1, 0.02)))
    boxes = cover_points_with_boxes(np.stack([np.full(len(y), 1.0), y, z], axis=1), 0.04)
    assert boxes.shape == (1, 2, 3)
    assert boxes[0, 1, 0] - boxes[0, 0, 0] == pytest.approx(0.01)
