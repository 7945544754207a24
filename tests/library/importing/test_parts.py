"""Units, hulls, one mesh of many, simplification, and the names that must not be followed."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.importing.asset_discovery import slugify_name
from grs_agents.library.importing.asset_preparation import choose_up_axis_by_height, guess_length_unit
from grs_agents.library.importing.convex_decomposition import compute_convex_hull, decompose_into_convex_parts
from grs_agents.library.importing.drop_testing import collider_volume, run_drop_test
from grs_agents.library.importing.mesh_simplification import simplify_textured_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import merge_mesh_parts
from grs_agents.library.importing.types import UP_TO_Z, ConvexHull, MeshPart, RefusedError, Up
from tests.library.importing import models


@pytest.mark.parametrize(("extent", "unit"), [(0.19, "m"), (19.0, "cm"), (190.0, "mm"), (1.5, "m"), (2500.0, "mm")])
def test_the_unit_is_that_in_which_a_thing_is_usual(extent: float, unit: str) -> None:
    assert guess_length_unit(extent)[0] == unit


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_what_is_up_comes_to_z(axis: Up) -> None:
    turn = UP_TO_Z[axis]
    assert np.allclose(turn @ np.eye(3)["xyz".index(axis)], (0, 0, 1))
    assert np.isclose(np.linalg.det(turn), 1)


def test_a_known_height_tells_the_axis() -> None:
    assert choose_up_axis_by_height(np.array([0.065, 0.043, 0.148]), 0.148, "y", []) == "z"
    assert choose_up_axis_by_height(np.array([0.072, 0.19, 0.073]), 0.19, "y", []) == "y"
    assert choose_up_axis_by_height(np.array([0.1, 0.1, 0.1]), 0.1, "y", []) == "y"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(8, 80))
def test_a_hull_is_convex_and_holds_its_points(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.05, 0.05, (count, 3)) + np.array([0.3, -2, 1])
    hull = compute_convex_hull(points)
    corners = hull.vertices[hull.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = np.einsum("fk,nfk->nf", normals, points[:, None] - corners[None, :, 0])
    assert (away <= 1e-9).all()
    assert 0 < collider_volume(hull) <= 0.001


def test_without_a_decomposer_a_bowl_collides_as_its_hull_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coacd", None)
    bowl = models.bowl()
    parts, notes = decompose_into_convex_parts(np.asarray(bowl.vertices), np.asarray(bowl.faces), True, 16)
    assert len(parts) == 1 and "grs-agents[assets]" in notes[0]


def test_a_decomposed_bowl_has_room_inside() -> None:
    bowl = models.bowl()
    parts, _ = decompose_into_convex_parts(np.asarray(bowl.vertices), np.asarray(bowl.faces), True, 16)
    assert 4 <= len(parts) <= 16
    assert sum(map(collider_volume, parts)) < 0.6 * collider_volume(compute_convex_hull(np.asarray(bowl.vertices)))


def test_what_cannot_stand_falls() -> None:
    cone = trimesh.creation.cone(0.03, 0.1)
    upright = ConvexHull(np.asarray(cone.vertices), np.asarray(cone.faces))
    assert run_drop_test([upright], 0.2, 0.6).is_stable
    assert not run_drop_test([ConvexHull(-upright.vertices, upright.faces)], 0.2, 0.6).is_stable


def test_parts_become_one_mesh_that_looks_the_same() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)
    uvs = np.tile([[0.2, 0.2], [0.8, 0.2], [0.5, 0.8]], (12, 1, 1))
    red = np.full((16, 16, 3), models.RED, np.uint8)
    plain = np.full((12, 3), models.BLUE, np.uint8)
    merged = merge_mesh_parts(
        [MeshPart(vertices, faces, uvs, red), MeshPart(vertices + 1, faces, None, None, plain)], 256
    )
    assert len(merged.faces) == 24 and len(merged.vertices) == 16
    height, width = merged.image.shape[:2]
    at = merged.uvs.mean(axis=1)
    texels = merged.image[((1 - at[:, 1]) * height).astype(int), (at[:, 0] * width).astype(int)]
    assert (texels[:12] == models.RED).all()
    assert np.abs(texels[12:].astype(int) - models.BLUE).max() <= 1


def test_each_texel_is_found_again_in_the_one_picture_of_several_parts() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)
    middle = (np.arange(12) + 2.5) / 16  # of a texel for each face, along u and down the picture
    corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.0, 0.4]]) / 16
    uvs = np.stack([middle, 1 - middle], axis=1)[:, None] + corners
    colors = np.random.default_rng(0).integers(0, 256, (3, 16, 16, 3), np.uint8)
    merged = merge_mesh_parts([MeshPart(vertices + part, faces, uvs, colors[part]) for part in range(3)], 256)
    height, width = merged.image.shape[:2]
    at = merged.uvs.mean(axis=1)
    texels = merged.image[((1 - at[:, 1]) * height).astype(int), (at[:, 0] * width).astype(int)]
    number = (middle * 16).astype(int)
    assert np.array_equal(texels, colors[:, number, number].reshape(-1, 3))


def test_a_simplified_mesh_keeps_its_size_and_its_colours() -> None:
    ball = trimesh.creation.icosphere(4, 0.05)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    height = vertices[faces].mean(axis=1)[:, 2]
    colors = np.where(height[:, None] > 0, models.RED, models.BLUE).astype(np.uint8)
    solid = merge_mesh_parts([MeshPart(vertices, faces, None, None, colors)], 256)
    fewer, notes = simplify_textured_mesh(solid, 500, 256)
    assert len(fewer.faces) <= 520 and notes
    assert np.allclose(np.ptp(fewer.vertices, axis=0), 0.1, atol=0.004)
    rows, columns = fewer.image.shape[:2]
    at, middle = fewer.uvs.mean(axis=1), fewer.vertices[fewer.faces].mean(axis=1)
    texels = fewer.image[((1 - at[:, 1]) * rows).astype(int), (at[:, 0] * columns).astype(int)]
    clear = np.abs(middle[:, 2]) > 0.01
    assert ((texels[:, 0] > 128) == (middle[:, 2] > 0))[clear].all()


@given(st.text(max_size=40))
def test_a_slug_is_a_safe_file_name(name: str) -> None:
    slug = slugify_name(name)
    assert slug and len(slug) <= 70 and slug.replace("_", "").replace("-", "").isalnum() and slug.isascii()


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x", "~/x", "c:\\x", "", "a\0b", "link"])
def test_names_that_leave_the_folder_are_refused(tmp_path: Path, name: str) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "x").write_text("secret")
    (home / "link").symlink_to(tmp_path / "x")
    with pytest.raises(RefusedError):
        SourceFolder(home, 1000).resolve_file(name)
