from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.sim import Zone, utils
from grs_agents.sim.world.collision_volumes import sample_collision_volume, volume_share_in_zones

LIBRARY = Library()
AT_ORIGIN = ((0.0, 0.0, 0.0), utils.IDENTITY)


def half(axis: int = 0) -> list[Zone]:
    """A zone over all places where the coordinate is negative."""
    x, y, z = (-1.0 if axis == own else 0.0 for own in range(3))
    return [Zone(pose=((x, y, z), utils.IDENTITY), size=(2.0, 2.0, 2.0))]


def model(*colliders: Shape) -> ObjectModel:
    return ObjectModel(visuals=(), colliders=colliders, mass=1, friction=1, bounds=((-1, -1, -1), (1, 1, 1)))


def test_every_collider_counts_by_its_volume() -> None:
    thick = Shape(kind="box", size=(0.1, 0.1, 0.1), position=(-0.2, 0, 0))
    thin = Shape(kind="box", size=(0.1, 0.1, 0.002), position=(0.2, 0, 0))
    volume = sample_collision_volume(model(thick, thin), LIBRARY)
    assert volume_share_in_zones(volume, AT_ORIGIN, half(), 1.0) == pytest.approx(0.1 / 0.102)


@pytest.mark.parametrize("shape", [Shape(kind="sphere", size=(0.03,)), Shape(kind="cylinder", size=(0.03, 0.1))])
def test_round_things_are_sampled_as_what_they_are(shape: Shape) -> None:
    points = sample_collision_volume(model(shape), LIBRARY).points
    assert np.hypot(points[0], points[1]).max() <= 0.03
    assert points.shape[1] > 100


def pyramid(folder: Path) -> Library:
    """A library beside the shipped one that has a mesh: a square base of 10 cm, its tip 10 cm above one edge."""
    corners = [(-0.05, -0.05, 0), (0.05, -0.05, 0), (0.05, 0.05, 0), (-0.05, 0.05, 0), (-0.05, 0, 0.1)]
    (folder / "pyramid.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners))
    return LIBRARY.copy_with_overlay_root(folder)


def test_a_mesh_counts_as_its_hull_not_as_its_box(tmp_path: Path) -> None:
    volume = sample_collision_volume(model(Shape(kind="mesh", size=(1, 1, 1), mesh="pyramid.obj")), pyramid(tmp_path))
    exact = 0.6875  # of a pyramid whose tip is above an edge, on that edge's side of the middle
    share = volume_share_in_zones(volume, AT_ORIGIN, half(), 1.0)
    assert share == pytest.approx(exact, abs=0.04)
    x, y, z = volume.points
    assert (np.abs(y) <= 0.05 * (1 - z / 0.1) + 1e-6).all()
    assert (x <= 0.05 - z + 1e-6).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(4, 60), st.integers(0, 10_000))
def test_half_spaces_hold_every_point_and_touch_the_farthest(count: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    planes = hull_half_spaces(points)
    heights = planes[:, :3] @ points.T - planes[:, 3:]
    assert heights.max() < 1e-6
    assert (np.abs(heights).min(axis=1) < 1e-6).all()
    direction = np.array([0.3, -0.5, 0.8])
    outside = points[(points @ direction).argmax()] + 0.01 * direction
    assert (planes[:, :3] @ outside > planes[:, 3]).any()


def test_points_in_one_plane_have_the_hull_of_their_box() -> None:
    flat = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    planes = hull_half_spaces(flat)
    assert (planes[:, :3] @ (0.5, 0.5, 0.0) <= planes[:, 3]).all()
    assert not (planes[:, :3] @ (0.5, 0.5, 0.1) <= planes[:, 3]).all()
