"""The toys have the published sizes and a hole where they need one."""

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from scripts.assets.toys import build_toys

LIBRARY = Library()


def test_the_published_sizes() -> None:
    sizes = {one.asset.name: one.asset.size for one in build_toys()}
    assert sizes["block/small.urdf"] == (0.01, 0.01, 0.01)
    assert sizes["sphere/sphere_rope.urdf"] == (0.01, 0.01, 0.01)
    assert [sizes[f"hanoi/disk{number}.urdf"][0] for number in range(4)] == pytest.approx([0.06, 0.07, 0.08, 0.09])
    assert sizes["hanoi/slimdisk.urdf"][2] == 0.005


@pytest.mark.parametrize("stem", ["disk0", "disk1", "disk2", "disk3", "slimdisk"])
def test_a_disk_drops_over_a_peg_of_the_stand(stem: str) -> None:
    disk, stand = LIBRARY.load_object_model(f"hanoi/{stem}.urdf"), LIBRARY.load_object_model("hanoi/stand.urdf")
    spec = mujoco.MjSpec()
    fixed, free = spec.worldbody, spec.worldbody.add_body(name="disk", pos=[0.002, 0.118, 0.07])
    free.add_freejoint()
    for body, model in ((fixed, stand), (free, disk)):
        for shape in model.colliders:
            x, y, z, w = shape.quaternion
            box = shape.kind == "box"
            half = [extent / 2 for extent in shape.size] if box else [shape.size[0], shape.size[1] / 2, 0]
            kind = mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CYLINDER
            body.add_geom(type=kind, size=half, pos=shape.position, quat=[w, x, y, z])
    world = spec.compile()
    data = mujoco.MjData(world)
    while data.time < 1:
        mujoco.mj_step(world, data)
    assert data.body("disk").xpos[2] == pytest.approx(0.005 + disk.size[2] / 2, abs=0.001)
    assert np.linalg.norm(data.body("disk").xpos[:2] - (0, 0.12)) < 0.011
