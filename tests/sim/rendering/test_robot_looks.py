"""The robot as it looks: one piece however it stands, and only in what is drawn."""

from itertools import pairwise

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rendering.robot_meshes import build_robot_meshes
from grs_agents.sim.rendering.stage import Props, Stage
from grs_agents.sim.world.compilation import compile_world
from grs_agents.sim.world.spec import instance_to_spec

LIBRARY = Library()


def model_bytes(instance: TaskInstance) -> bytes:
    """The world that simulates an instance, as MuJoCo writes it."""
    model = compile_world(instance_to_spec(instance, LIBRARY)).model
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_the_robot_is_one_piece_at_any_joints_and_only_in_pictures(robot: str) -> None:
    instance = TaskInstance(task="T", seed=0, max_steps=1, timestep=0.002, objects=(), goals=(), robot=robot)
    before, arm, rng = model_bytes(instance), get_arm(robot), np.random.default_rng(0)
    stage, plain = (Stage(Props((), arm, dressed=dressed), LIBRARY) for dressed in (True, False))
    assert model_bytes(instance) == before
    assert stage.model.ngeom > 2 * plain.model.ngeom
    assert len(np.unique(stage.model.geom_rgba[stage.model.geom_group == 1], axis=0)) > 2
    links = [0, *(int(stage.model.body(name).id) for name in arm.link_names)]
    solids = [np.flatnonzero((stage.model.geom_bodyid == body) & (stage.model.geom_group == 1)) for body in links]
    for joints in rng.uniform(arm.lower_joint_limits, arm.upper_joint_limits, (6, arm.dof)):
        for one in (stage, plain):
            one.set_joint_positions(joints)
            one.update()
        assert np.allclose(stage.tip_pose, plain.tip_pose, atol=1e-12)
        for pair in pairwise(solids):
            gaps = [mujoco.mj_geomDistance(stage.model, stage.data, a, b, 1.0, None) for a in pair[0] for b in pair[1]]
            assert min(gaps) <= 1e-4
    for own in solids:  # of one link, each touches what the others make
        reached, left = {int(own[0])}, {int(geom) for geom in own[1:]}
        while near := {
            b
            for b in left
            if any(mujoco.mj_geomDistance(stage.model, stage.data, a, b, 1.0, None) <= 1e-4 for a in reached)
        }:
            reached, left = reached | near, left - near
        assert not left


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_the_meshes_are_the_solids_that_are_drawn(robot: str) -> None:
    stage, meshes = Stage(Props((), get_arm(robot)), LIBRARY), build_robot_meshes(get_arm(robot))
    assert set(meshes) == {"world", *get_arm(robot).link_names}
    for name, mesh in meshes.items():
        corners = mesh.vertices[mesh.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", across, mesh.normals[mesh.triangles].mean(axis=1)) >= -1e-12).all()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
        geoms = np.flatnonzero((stage.model.geom_bodyid == stage.model.body(name).id) & (stage.model.geom_group == 1))
        reach = max(float(np.linalg.norm(stage.model.geom_pos[g]) + stage.model.geom_rbound[g]) for g in geoms)
        assert 0.5 * reach < float(np.linalg.norm(mesh.vertices, axis=1).max()) <= reach + 1e-6
