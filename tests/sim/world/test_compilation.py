import math
from pathlib import Path

import numpy as np
import pytest
from sim_scenes import at

from grs_agents.library.library import Library
from grs_agents.library.mesh_files import convex_mesh_volume
from grs_agents.perception.proxies.meshes import box_mesh, mesh_to_obj_text, revolved_mesh
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.compilation import build_world

HAMMER = """<robot name="hammer"><link name="hammer">
<inertial><mass value="0.4"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
<collision><geometry><mesh filename="unit.obj" scale="0.1 0.04 0.04"/></geometry></collision>
<collision><origin xyz="0 0 -0.12"/><geometry><mesh filename="unit.obj" scale="0.02 0.02 0.2"/></geometry></collision>
<collision><origin xyz="0 0 -0.22"/><geometry><sphere radius="0.01"/></geometry></collision>
</link></robot>"""


def test_the_parts_of_an_object_share_its_mass_by_their_volume(tmp_path: Path) -> None:
    (tmp_path / "hammer.urdf").write_text(HAMMER)
    (tmp_path / "unit.obj").write_text(mesh_to_obj_text(box_mesh((1.0, 1.0, 1.0))))
    (tmp_path / "manifest.json").write_text('{"version": 1, "assets": []}')
    world = build_world([InstanceObject(id=1, asset="hammer.urdf", pose=at(0.5, 0.0, 0.3))], Library(tmp_path))
    body = world.model.body("object_1")
    head, handle, knob = 0.1 * 0.04 * 0.04, 0.02 * 0.02 * 0.2, 4 / 3 * math.pi * 0.01**3
    total = head + handle + knob
    assert body.mass[0] == pytest.approx(0.4, rel=1e-6)
    assert body.ipos[2] == pytest.approx(-(0.12 * handle + 0.22 * knob) / total, rel=1e-3)
    middle = body.ipos[2]
    across = sum(
        0.4 * volume / total * (own + (place - middle) ** 2)
        for volume, own, place in (
            (head, (0.1**2 + 0.04**2) / 12, 0.0),
            (handle, (0.02**2 + 0.2**2) / 12, -0.12),
            (knob, 0.4 * 0.01**2, -0.22),
        )
    )
    assert max(body.inertia) == pytest.approx(across, rel=1e-3)


def test_the_volume_of_a_mesh_does_not_depend_on_how_its_faces_are_turned(tmp_path: Path) -> None:
    vertices, faces = revolved_mesh([(0, -1), (2, -1), (2, 1), (0, 1)])
    turned = np.where((np.arange(len(faces)) % 2 == 0)[:, None], faces, faces[:, ::-1])
    (tmp_path / "solid.obj").write_text(mesh_to_obj_text((vertices + 5, turned)))
    prism = 32 * 2**2 * math.sin(2 * math.pi / 32) / 2 * 2  # 32 sides
    assert convex_mesh_volume(tmp_path / "solid.obj") == pytest.approx(prism, rel=1e-3)
