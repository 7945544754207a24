"""Meshes of a user's arm: hulls of few vertices in a simulation, in full in a picture."""

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.stage import Props, Stage
from grs_agents.sim.world.compilation import build_world
from tests.gantry import GANTRY

_RINGS, _SIDES = 60, 80
_RADII = np.array([0.03, 0.02, 0.05])
_MESHES = """
  <asset>
    <mesh file="link.obj" scale="1.1 1 1" refpos="0.002 0 0"/>
    <mesh name="cover" file="cover.obj"/>
    <material name="red" rgba="1 0 0 1"/>
  </asset>
  <worldbody>"""
_GEOMS = """
          <geom type="mesh" mesh="link" pos="0 0.01 0.05" quat="0.9 0.1 0.3 0.2" density="500"/>
          <geom type="mesh" mesh="cover" material="red" contype="0" conaffinity="0" density="700"/>
          <geom type="capsule" mesh="link" pos="0 0 0.1"/>
          <joint name="z" """


def write_ellipsoid(file) -> int:
    """An ellipsoid in OBJ, of many vertices; returns their number."""
    heights, turns = np.meshgrid(np.linspace(-1, 1, _RINGS), np.linspace(0, 2 * np.pi, _SIDES, endpoint=False))
    radius = np.sqrt(1 - heights**2) + 0.1
    points = np.stack([radius * np.cos(turns), radius * np.sin(turns), heights], axis=-1).reshape(-1, 3) * _RADII
    lines = ["v {} {} {}".format(*point) for point in points]
    for side in range(_SIDES):
        for ring in range(_RINGS - 1):
            first, second = side * _RINGS + ring + 1, (side + 1) % _SIDES * _RINGS + ring + 1
            lines += [f"f {first} {second} {second + 1}", f"f {first} {second + 1} {first + 1}"]
    file.write_text("\n".join(lines))
    return len(points)


def support(model, body, directions):
    """Extents (N,) of a body's colliders along directions (N, 3), m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    far = np.full(len(directions), -np.inf)
    for geom in np.flatnonzero(model.geom_bodyid == model.body(body).id):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and model.geom_contype[geom]:
            mesh = model.geom_dataid[geom]
            points = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            points = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            far = np.maximum(far, (directions @ points.T).max(axis=1))
    return far


def test_meshes_of_a_file_may_have_the_names_of_hulls(tmp_path) -> None:
    names = ("link", "link_hull", "hull_0")
    meshes = "".join(f'<mesh name="{name}" file="link.obj"/>' for name in names)
    geoms = "".join(f'<geom type="mesh" mesh="{name}" density="500"/>' for name in names)
    count = write_ellipsoid(tmp_path / "link.obj")
    text = GANTRY.replace("<worldbody>", f"<asset>{meshes}</asset><worldbody>", 1)
    (tmp_path / "arm.xml").write_text(text.replace('<joint name="z" ', f'{geoms}<joint name="z" ', 1))
    model = build_world((), Library(), arm=get_arm(str(tmp_path / "arm.xml"))).model
    assert model.nmesh == len(names) and model.nmeshvert < count / 5


@pytest.fixture(scope="module")
def mesh_arm(tmp_path_factory):
    """A gantry with meshes, and the number of vertices of each."""
    folder = tmp_path_factory.mktemp("mesh_arm")
    count = write_ellipsoid(folder / "link.obj")
    write_ellipsoid(folder / "cover.obj")
    text = GANTRY.replace("<worldbody>", _MESHES, 1).replace('<joint name="z" ', _GEOMS.lstrip(), 1)
    (folder / "arm.xml").write_text(text)
    return folder / "arm.xml", count


def test_a_simulation_has_hulls_of_few_vertices_where_the_file_has_meshes(mesh_arm) -> None:
    file, count = mesh_arm
    full, reduced = mujoco.MjModel.from_xml_path(str(file)), build_world((), Library(), arm=get_arm(str(file))).model
    assert full.nmeshvert == 2 * count
    assert reduced.nmeshvert < 300
    before, after = full.body("mast"), reduced.body("arm_mast")
    assert after.mass == pytest.approx(before.mass)  # with that of what is left out
    assert after.inertia == pytest.approx(before.inertia)
    assert np.sort(reduced.geom_size[reduced.geom_bodyid == after.id][:, :2], axis=0) == pytest.approx(
        np.sort(full.geom_size[(full.geom_bodyid == before.id) & (full.geom_contype > 0)][:, :2], axis=0), abs=2e-3
    )
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    gaps = support(full, "mast", directions) - support(reduced, "arm_mast", directions)
    assert gaps.min() > -1e-5
    assert gaps.max() < 0.001


def test_a_picture_has_the_full_meshes_of_the_looks_and_of_bodies_without_any_those_that_collide(
    mesh_arm, tmp_path
) -> None:
    file, count = mesh_arm
    model = Stage(Props((), get_arm(str(file))), Library()).model
    assert model.nmeshvert == count
    assert [model.geom(geom).group for geom in np.flatnonzero(model.geom_bodyid == model.body("arm_mast").id)] == [1]
    write_ellipsoid(tmp_path / "link.obj")
    write_ellipsoid(tmp_path / "cover.obj")
    bare = file.read_text().replace(' material="red" contype="0" conaffinity="0"', "")
    (tmp_path / "arm.xml").write_text(bare)
    assert Stage(Props((), get_arm(str(tmp_path / "arm.xml"))), Library()).model.nmeshvert == 2 * count
