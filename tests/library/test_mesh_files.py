"""Vertices of OBJ files."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.errors import InputError
from grs_agents.library import read_vertices

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
