"""Every asset of the shipped library: it parses, looks like something, weighs something and stands still."""

import csv
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.asset import Asset
from grs_agents.library.colors import COLORS
from grs_agents.library.library import Library
from grs_agents.library.shapes import Shape

LIBRARY = Library()
ASSETS = LIBRARY.assets()
MOVING = [asset for asset in ASSETS if asset.mass > 0]
FLAT = ("zone", "line", "corner", "square", "rectangle", "mark", "ground")
MIDDLES = {
    "corner/corner-template.urdf": (0.025, 0.025, 0),
    "hanoi/stand.urdf": (0, 0, 0.025),
    "insertion/ell.urdf": (0.025, 0.025, 0),
    "insertion/fixture.urdf": (0.025, 0.0243, 0),
    "kitting/object-template.urdf": (0, 0, 0.01),
    "kitting/object-template-nocollision.urdf": (0, 0, 0.01),
    "plane/plane.urdf": (0, 0, -0.05),
    "square/square-template.urdf": (0, -0.0025, 0),
    "rectangle/rectangle-template-sides-1.urdf": (0, -0.05, 0),
    "rectangle/rectangle-template-sides-1_test.urdf": (0, -0.05, 0),
    "rectangle/rectangle-template-sides-2.urdf": (0.0025, -0.0025, 0),
    "rectangle/rectangle-template-sides-3.urdf": (0, -0.0025, 0),
}
"""The middles of things whose published origin is not their middle."""
EVERY = pytest.mark.parametrize("asset", ASSETS, ids=lambda asset: asset.name)
HEAVY = pytest.mark.parametrize("asset", MOVING, ids=lambda asset: asset.name)


@EVERY
def test_its_urdf_agrees_with_the_manifest(asset: Asset) -> None:
    model = LIBRARY.load_object_model(asset.name)
    assert np.allclose(model.size, asset.size, atol=0.002)
    assert np.allclose(np.add(*model.bounds) / 2, MIDDLES.get(asset.name, (0, 0, 0)), atol=0.001)
    assert (model.mass, model.friction) == pytest.approx((asset.mass, asset.friction), rel=1e-4)
    assert asset.color in COLORS
    tiny = asset.name in ("block/small.urdf", "sphere/sphere_rope.urdf")
    assert (0.001 if tiny else 0.02) <= asset.mass <= 2.0 or (asset.mass == 0 and asset.category in FLAT)
    assert asset.everyday or not asset.fixture
    assert len(asset.description) > 8


@EVERY
def test_its_files_exist_and_its_mesh_is_closed_light_and_of_its_size(asset: Asset) -> None:
    model = LIBRARY.load_object_model(asset.name)
    meshes = [shape for shape in model.visuals if shape.mesh is not None]
    corners: list[np.ndarray] = []
    for shape in meshes:
        mesh = trimesh.load_mesh(LIBRARY.mesh_or_texture_path(shape.mesh or ""), process=False)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        assert mesh.is_watertight
        assert mesh.volume > 0
        assert len(mesh.faces) < 2000
        corners += list(mesh.bounds * shape.size)
        if shape.texture is not None:
            image = cv2.imread(str(LIBRARY.mesh_or_texture_path(shape.texture)))
            assert image is not None
            assert image.std() > 5
    if meshes:
        assert all(shape.position == (0, 0, 0) for shape in meshes)
        assert np.allclose(np.ptp(corners, axis=0), asset.size, atol=0.002)


def test_the_groceries_have_the_published_sizes() -> None:
    file = Path(__file__).parent / "hope_sizes.csv"
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 28
    for row in rows:
        asset = LIBRARY.asset(f"HOPE/{row['kind']}.urdf")
        assert asset.size == tuple(float(row[f"{side}_m"]) for side in ("depth", "width", "height"))
        assert asset.category == row["shape"]


def test_the_names_of_published_programs_are_there() -> None:
    wanted = (Path(__file__).parent / "published_names.txt").read_text().split()
    assert set(wanted) <= set(LIBRARY.asset_names())
    assert {f"block/{color}_block.urdf" for color in ("red", "green", "blue", "yellow")} <= set(LIBRARY.asset_names())


def test_the_parts_of_published_programs_are_not_looked_for_in_photos() -> None:
    things = {asset.name for asset in LIBRARY.everyday_assets()}
    assert {"HOPE/Milk.urdf", "block/red_block.urdf", "bowl/bowl.urdf"} <= things
    assert not {"hanoi/block.urdf", "kitting/kit.urdf", "ball/ball.urdf"} & things


def test_the_library_is_small() -> None:
    assert sum(file.stat().st_size for file in LIBRARY.roots[0].rglob("*") if file.is_file()) < 8_000_000


@EVERY
def test_another_urdf_reader_loads_it(asset: Asset) -> None:
    text = LIBRARY.fill_template(asset.name, {}) if asset.template else LIBRARY.asset_path(asset.name).read_text()
    meshes = [shape.mesh for shape in LIBRARY.load_object_model(asset.name).visuals if shape.mesh]
    files = {name.rsplit("/", 1)[-1]: LIBRARY.mesh_or_texture_path(name).read_bytes() for name in meshes}
    loaded = mujoco.MjModel.from_xml_string(text, files)
    assert loaded.ngeom >= text.count("<collision>")


def add(spec: Any, body: Any, shape: Shape, friction: float, mass: float) -> None:
    """Give a body one collision shape."""
    x, y, z, w = shape.quaternion
    if shape.kind == "box":
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, [extent / 2 for extent in shape.size]
    elif shape.kind == "sphere":
        kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, [shape.size[0], 0, 0]
    elif shape.kind == "mesh":
        name = f"mesh_{len(spec.meshes)}"
        spec.add_mesh(name=name, file=str(LIBRARY.mesh_or_texture_path(shape.mesh or "")), scale=shape.size)
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, pos=shape.position, quat=[w, x, y, z], mass=mass)
        geom.meshname, geom.friction[0] = name, friction
        return
    else:
        kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [shape.size[0], shape.size[1] / 2, 0]
    geom = body.add_geom(type=kind, size=size, pos=shape.position, quat=[w, x, y, z], mass=mass)
    geom.friction[0] = friction


@pytest.fixture(scope="module")
def rested() -> dict[str, tuple[float, float, float]]:
    """Tilt (degrees), drift (m) and speed (m/s) of every asset after one second on a plane."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = 0.002, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 1])
    for index, asset in enumerate(MOVING):
        model = LIBRARY.load_object_model(asset.name)
        height = -model.bounds[0][2] + 0.001
        body = spec.worldbody.add_body(name=asset.name, pos=[0.5 * (index % 8), 0.5 * (index // 8), height])
        body.add_freejoint()
        for shape in model.colliders:
            add(spec, body, shape, model.friction, model.mass / len(model.colliders))
    world = spec.compile()
    data = mujoco.MjData(world)
    mujoco.mj_forward(world, data)
    before = {asset.name: data.body(asset.name).xpos.copy() for asset in MOVING}
    while data.time < 1.0:
        mujoco.mj_step(world, data)
    rested: dict[str, tuple[float, float, float]] = {}
    for asset in MOVING:
        body = data.body(asset.name)
        tilt = math.degrees(math.acos(np.clip(body.xmat[8], -1, 1)))
        drift = float(np.linalg.norm(body.xpos - before[asset.name]))
        rested[asset.name] = (tilt, drift, float(np.linalg.norm(body.cvel[3:])))
    return rested


@HEAVY
def test_it_stands_still(asset: Asset, rested: dict[str, tuple[float, float, float]]) -> None:
    tilt, drift, speed = rested[asset.name]
    assert tilt < 5
    assert drift < 0.005
    assert speed < 0.01
