"""What stands for objects without an asset, as assets of a run."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import Vec3
from grs_agents.library import mesh_files
from grs_agents.library.library import Library
from grs_agents.perception.proxies.proxy import Proxy, primitive_proxy, write_proxy
from grs_agents.perception.shapes.colliders import Hull
from grs_agents.perception.shapes.types import ObjectMesh, make_object_view
from grs_agents.perception.types import Solid, UprightBox
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.collision_volumes import measure_inner_size
from grs_agents.sim.world.compilation import build_world
from tests.perception.settling.photo import LIBRARY, MILK, photo_of, standing

SIZE: Vec3 = (0.12, 0.12, 0.08)
RED: Vec3 = (0.8, 0.1, 0.1)


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("solid", ["box", "cylinder"])
def test_a_primitive_has_the_measured_size_and_room_if_it_is_hollow(tmp_path: Path, solid: Solid, hollow: bool) -> None:
    asset = write_proxy(tmp_path, "thing", primitive_proxy(solid, SIZE, RED, hollow), "a thing")
    model = Library(tmp_path).load_object_model(asset.name)
    assert model.size == pytest.approx(SIZE, rel=0.02)
    assert asset.hollow == hollow
    room = measure_inner_size(model, Library(tmp_path))
    assert (room is not None) == hollow
    assert room is None or room == pytest.approx((0.11, 0.11, 0.075), abs=0.006)


def test_a_primitive_shows_what_the_photo_shows(tmp_path: Path) -> None:
    frame, table, mask = photo_of([standing(MILK, 0.5, 0.0)], LIBRARY)
    box = UprightBox(center=(0.5, 0.0, 0.095), size=(0.072, 0.073, 0.19), yaw=0.0)
    proxy = primitive_proxy("box", box.size, RED, view=make_object_view(frame, table, mask, box, 0.001))
    seen = frame.rgb[mask].mean(axis=0)
    assert proxy.mesh.texture.reshape(-1, 3).mean(axis=0) == pytest.approx(seen, abs=12)
    assert np.ptp(proxy.mesh.uvs, axis=0).min() > 0.5
    write_proxy(tmp_path, "carton", proxy, "a carton")
    assert Library(tmp_path).mesh_or_texture_path("proxy/carton.png").is_file()


def test_a_shape_is_written_about_the_middle_of_its_colliders_with_the_mass_of_its_volume(tmp_path: Path) -> None:
    vertices = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)]) + np.array(
        (0.02, 0.0, 0.0)
    )
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])
    mesh = ObjectMesh(vertices, faces, np.zeros((4, 2)), np.full((2, 2, 3), 200, np.uint8))
    proxy = Proxy(mesh, (Hull(vertices),), hollow=False, color=RED)
    asset = write_proxy(tmp_path, "corner", proxy, "a corner")
    library = Library(tmp_path)
    model = library.load_object_model(asset.name)
    assert proxy.center == pytest.approx((0.07, 0.05, 0.05))
    assert np.abs(model.bounds).max() == pytest.approx(0.05, abs=1e-5)
    assert asset.mass == pytest.approx(300 * 0.1**3 / 6, abs=1e-4)
    seen = mesh_files.read_vertices(library.mesh_or_texture_path("proxy/corner.obj"))
    assert seen + proxy.center == pytest.approx(vertices, abs=1e-5)
    world = build_world([InstanceObject(id=0, asset=asset.name, pose=((0.5, 0.0, 0.05), (0, 0, 0, 1)))], library)
    assert world.model.body("object_0").mass[0] == pytest.approx(asset.mass)
    middle = world.model.body("object_0").ipos + proxy.center
    assert middle == pytest.approx(vertices.mean(axis=0), abs=2e-3)
