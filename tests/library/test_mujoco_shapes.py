import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.mujoco_shapes import add_shape_geom, add_texture_file
from grs_agents.library.shapes import Shape
from tests.bombs import png


def compiled_extent(file: Path) -> float:
    spec = mujoco.MjSpec()
    add_shape_geom(spec, spec.worldbody, Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=file.name), "thing", file)
    return float(np.ptp(spec.compile().mesh_vert, axis=0).max())


def test_a_mesh_that_is_written_again_within_a_second_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "thing.obj"
    for side, modified in ((1.0, 1e9 + 0.1), (2.0, 1e9 + 0.6), (3.0, 1e9 + 0.9)):
        trimesh.creation.box((side, side, side)).export(file)
        os.utime(file, (modified, modified))
        assert np.isclose(compiled_extent(file), side)


def test_textures_of_a_world_are_bounded_before_they_are_decoded(tmp_path: Path) -> None:
    scan, bomb = png(tmp_path / "scan.png", 4096, 4096, rows=2), png(tmp_path / "bomb.png", 4096, 4097, rows=2)
    spec = mujoco.MjSpec()
    with pytest.raises(InputError, match=r"bomb\.png has 4096x4097 pixels, at most 16777216"):
        add_texture_file(spec, "bomb", bomb)
    for number in range(4):
        add_texture_file(spec, f"scan_{number}", scan)
    with pytest.raises(InputError, match=r"scan\.png.* 83886080 pixels, at most 67108864"):
        add_texture_file(spec, "fifth", scan)
