"""Known solids get simple colliders that are as large as they are, stand flat and have a top to hold on to."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.shapes import Shape
from grs_agents.perception.shapes.colliders import Collider, Hull, clip_hull_corners_to_half_space, fit_colliders
from grs_agents.perception.shapes.types import ObjectMesh, ObjectShape
from grs_agents.perception.types import Array, Mask

RNG = np.random.default_rng(0)


def shape_of(mesh: trimesh.Trimesh, walls: Array | None = None) -> ObjectShape:
    """The mesh of a shape, standing on the support."""
    vertices = np.asarray(mesh.vertices, np.float64) - (0.0, 0.0, mesh.bounds[0][2])
    faces, uvs = np.asarray(mesh.faces, np.int64), np.zeros((len(vertices), 2))
    textured = ObjectMesh(vertices, faces, uvs, np.zeros((2, 2, 3), np.uint8))
    return ObjectShape(textured, "lathe" if walls is not None else "voxels", walls is not None, walls, 1.0, 0.0)


def moved(mesh: trimesh.Trimesh, x: float, y: float, z: float) -> trimesh.Trimesh:
    mesh.apply_translation((x, y, z))
    return mesh


def joined(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    """Meshes as one."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])[:-1]
    faces = [np.asarray(part.faces) + start for part, start in zip(parts, starts, strict=True)]
    return trimesh.Trimesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces), process=False)


def held_by(colliders: tuple[Collider, ...], points: Array) -> Mask:
    """Which of (N, 3) points are in any of some colliders."""
    found = np.zeros(len(points), np.bool_)
    for one in colliders:
        if isinstance(one, Hull):
            planes = trimesh.convex.convex_hull(one.corners)
            inside = (points @ planes.face_normals.T <= (planes.face_normals * planes.triangles[:, 0]).sum(axis=1)).all(
                axis=1
            )
        elif one.kind == "box":
            inside = (np.abs(points - one.position) <= np.array(one.size) / 2).all(axis=1)
        else:
            local = points - one.position
            inside = (np.hypot(local[:, 0], local[:, 1]) <= one.size[0]) & (np.abs(local[:, 2]) <= one.size[1] / 2)
        found |= inside
    return found


def overlap(colliders: tuple[Collider, ...], solid: trimesh.Trimesh) -> float:
    """Intersection over union of colliders and a convex solid, counted at points."""
    low, high = solid.bounds
    points = RNG.uniform(low - 0.01, high + 0.01, (6000, 3))
    planes = (points @ solid.face_normals.T <= (solid.face_normals * solid.triangles[:, 0]).sum(axis=1) + 1e-9).all(1)
    held = held_by(colliders, points)
    return float((held & planes).sum() / (held | planes).sum())


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(0.03, 0.2)] * 3), st.booleans())
def test_a_box_and_a_can_are_primitives_of_their_size(size: tuple[float, float, float], around: bool) -> None:
    mesh = trimesh.creation.cylinder(size[0] / 2, size[2]) if around else trimesh.creation.box(size)
    (one,) = fit_colliders(shape_of(mesh), "box", hollow=False)
    assert isinstance(one, Shape) and one.kind == ("cylinder" if around else "box")
    if around:
        assert one.size == pytest.approx((size[0] / 2, size[2]), abs=0.002)
    else:
        assert sorted(one.size) == pytest.approx(sorted(size), abs=0.002)
    assert one.position[2] == pytest.approx(size[2] / 2, abs=1e-6)


def test_what_is_convex_is_one_hull_with_a_flat_foot_and_a_flat_top() -> None:
    ball = trimesh.creation.icosphere(3, 0.05)
    (one,) = fit_colliders(shape_of(ball), "cylinder", hollow=False)
    assert isinstance(one, Hull) and len(one.corners) < 64
    assert overlap((one,), moved(ball, 0, 0, 0.05)) > 0.85
    for level in (0.0, one.corners[:, 2].max()):
        flat = one.corners[np.abs(one.corners[:, 2] - level) < 1e-9, :2]
        assert np.ptp(flat, axis=0).min() > 0.015


def test_a_pointed_thing_ends_where_a_cup_finds_a_seat() -> None:
    cone = trimesh.creation.cone(0.1, 0.15)
    for _ in range(3):
        cone = cone.subdivide()
    colliders = fit_colliders(shape_of(cone), "cylinder", hollow=False)
    corners = np.concatenate([one.corners for one in colliders if isinstance(one, Hull)])
    top = corners[corners[:, 2] > corners[:, 2].max() - 1e-6, :2]
    assert np.ptp(top, axis=0).min() > 0.016
    assert 0.125 < corners[:, 2].max() < 0.14


def test_an_angle_is_pieces_that_leave_its_corner_free() -> None:
    upright = moved(trimesh.creation.box((0.03, 0.03, 0.1)), -0.035, 0, 0.05)
    lying = moved(trimesh.creation.box((0.1, 0.03, 0.03)), 0, 0, 0.015)
    colliders = fit_colliders(shape_of(joined(upright, lying)), "box", hollow=False)
    assert 2 <= len(colliders) <= 6
    assert not held_by(colliders, np.array([(0.03, 0.0, 0.07)])).any()
    assert held_by(colliders, np.array([(-0.035, 0.0, 0.08), (0.04, 0.0, 0.012)])).all()


WALLS = np.array([(0.03, 0.035, 0.005), (0.045, 0.05, 0.05), (0.05, 0.055, 0.09)])


def lathe(walls: Array) -> trimesh.Trimesh:
    """A cup with these walls."""
    outside = [(0.0, 0.0), (float(walls[0, 1]), 0.0), *((float(outer), float(z)) for _, outer, z in walls)]
    inside = [(float(inner), float(z)) for inner, _, z in walls[::-1]]
    return trimesh.creation.revolve([*outside, *inside, (0.0, float(walls[0, 2]))], sections=48)


def test_one_can_put_something_into_a_cup_and_take_it_by_its_handle() -> None:
    handle = moved(trimesh.creation.box((0.03, 0.008, 0.05)), 0.065, 0, 0.05)
    mesh = moved(joined(lathe(WALLS), handle), 0.01, -0.02, 0.0)
    colliders = fit_colliders(shape_of(mesh, WALLS), "cylinder", hollow=False)
    angles = np.linspace(0, 2 * np.pi, 40)
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(40)], axis=1)
    middle = np.array((0.01, -0.02, 0.0))
    assert not held_by(colliders, middle + 0.025 * around + (0, 0, 0.02)).any()
    assert not held_by(colliders, middle + 0.04 * around + (0, 0, 0.07)).any()
    assert held_by(colliders, middle + 0.0505 * around + (0, 0, 0.07)).mean() > 0.9
    assert held_by(colliders, middle + 0.02 * around + (0, 0, 0.002)).all()
    assert held_by(colliders, middle + np.array([(0.075, 0.0, 0.05)])).all()


@pytest.mark.parametrize("solid", ["box", "cylinder"])
def test_what_is_known_to_be_hollow_is_so_though_its_shape_is_full(solid: str) -> None:
    mesh = trimesh.creation.box((0.12, 0.1, 0.06)) if solid == "box" else trimesh.creation.cylinder(0.06, 0.06)
    colliders = fit_colliders(shape_of(mesh), "box" if solid == "box" else "cylinder", hollow=True)
    assert not held_by(colliders, np.array([(0.0, 0.0, 0.03), (0.04, 0.0, 0.05)])).any()
    assert held_by(colliders, np.array([(0.0, 0.0, 0.001)])).all()


def test_walls_of_a_hollow_shape_that_begins_above_its_support_reach_down_to_it() -> None:
    shape = shape_of(trimesh.creation.cylinder(0.06, 0.06))
    raised = replace(shape, mesh=replace(shape.mesh, vertices=np.add(shape.mesh.vertices, (0.0, 0.0, 0.03))))
    colliders = fit_colliders(raised, "cylinder", hollow=True)
    assert held_by(colliders, np.array([(0.0, 0.0, 0.001), (0.059, 0.0, 0.015), (0.059, 0.0, 0.08)])).all()
    assert not held_by(colliders, np.array([(0.0, 0.0, 0.015), (0.0, 0.0, 0.06)])).any()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 1000), st.floats(-1, 1))
def test_a_cut_hull_is_what_lies_on_one_side(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    corners, normal = rng.normal(size=(30, 3)) * 0.05, rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    along = corners @ normal
    offset = float(along.mean() + share * np.ptp(along) / 2)
    left = clip_hull_corners_to_half_space(corners, normal, offset)
    assert (left @ normal <= offset + 1e-9).all()
    assert {tuple(one) for one in corners[along <= offset]} >= {
        tuple(one) for one in left if abs(one @ normal - offset) > 1e-9
    }
    if along.min() < offset < along.max():
        assert (left @ normal).max() == pytest.approx(offset, abs=1e-9)


def test_a_shape_that_is_thinner_than_what_touches_may_be_is_a_thin_box() -> None:
    plate = joined(
        trimesh.creation.box((0.05, 0.01, 0.0015)), moved(trimesh.creation.box((0.01, 0.05, 0.0015)), 0, 0.03, 0)
    )
    (collider,) = fit_colliders(shape_of(plate), "box", hollow=False)
    assert isinstance(collider, Shape)
    assert collider.size == pytest.approx((0.05, 0.06, 0.002))
    assert collider.position[2] == pytest.approx(0.001)  # on its support
