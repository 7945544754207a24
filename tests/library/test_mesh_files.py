"""Vertices and faces of OBJ files."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.mesh_files import read_surface, read_vertices

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nvt 0 0\nf 1/1 2/1 3/1\n"


def test_vertices_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    vertices = read_vertices(tmp_path / "a.obj")
    assert vertices.shape == (4, 3)
    assert np.allclose(vertices.max(axis=0), (1, 1, 2))


@pytest.mark.parametrize("text", ["", "v 0 0 0\n", TETRAHEDRON + "v nan 0 0\n", "v 1 2\n" * 4, "v a b c\n" * 4])
def test_a_faulty_mesh_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.obj").write_text(text)
    with pytest.raises(InputError, match="bad"):
        read_vertices(tmp_path / "bad.obj")


def test_other_formats_and_missing_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text("<x/>")
    with pytest.raises(InputError, match=r"a\.dae"):
        read_vertices(tmp_path / "a.dae")
    with pytest.raises(InputError, match=r"b\.obj"):
        read_vertices(tmp_path / "b.obj")


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nvt 0.1 0.2\nvt 0.3 0.4 0.0\nvt 0.5 0.6\nvn 0 0 1\n"
UVS = [[(0.1, 0.2), (0.3, 0.4), (0.5, 0.6)], [(0.5, 0.6), (0.3, 0.4), (0.1, 0.2)]]


@pytest.mark.parametrize(
    ("faces", "has_uvs"),
    [
        ("f 1 2 3\nf 4 3 2\n", False),
        ("f 1//1 2//1 3//1\nf 4//1 3//1 2//1\n", False),
        ("f 1/1 2/2 3/3\nf 4/3 3/2 2/1\n", True),
        ("f 1/1/1 2/2/1 3/3/1\nf 4/3/1 3/2/1 2/1/1\n", True),
        ("f 1/1 2/2/1 3/3\nf 4/3/1 3/2 2/1\n", True),
        ("f -4/-3 -3/-2 -2/-1\nf -1/-1 3/2 2/1\n", True),
        ("f  1/1 2/2   3/3 \nf 4/3 3/2 2/1\n", True),
    ],
)
def test_a_surface_is_the_same_however_its_faces_are_spelled(tmp_path: Path, faces: str, has_uvs: bool) -> None:
    (tmp_path / "a.obj").write_text(CORNERS + faces)
    surface = read_surface(tmp_path / "a.obj")
    assert surface.corners.tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 2], [0, 1, 0], [1, 0, 0]]]
    assert np.allclose(surface.uvs, UVS if has_uvs else 0)


@pytest.mark.parametrize(
    "faces", ["", "f 1 2\n", "f 1 2 5\n", "f 0 1 2\n", "f 1/4 2/1 3/1\n", "f 1 2 -5\n", "f a b c\n"]
)
def test_faces_of_what_is_not_there_are_named(tmp_path: Path, faces: str) -> None:
    (tmp_path / "bad.obj").write_text(CORNERS + faces)
    with pytest.raises(InputError, match="bad"):
        read_surface(tmp_path / "bad.obj")
