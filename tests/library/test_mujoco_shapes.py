import os
from pathlib import Path

import numpy as np
import trimesh

from grs_agents.library import Shape, add_shape_geom
from grs_agents.mujoco_import import mujoco


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
