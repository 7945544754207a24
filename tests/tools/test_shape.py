"""The shape tool: a model of one's own writes a mesh file, which comes to lie where the photo shows the object."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, cast

import cv2
import numpy as np
import pytest
import trimesh

from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import rotation_about_z
from grs_agents.graph.placement import reconstruct_proxy
from grs_agents.graph.services import Photo, Services
from grs_agents.library.importing.types import UP_TO_Z
from grs_agents.library.library import Library
from grs_agents.perception.proxies.proxy import Proxy, write_proxy
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.shapes.colliders import Hull
from grs_agents.perception.shapes.mesh_file import MeshFile, fit_mesh_file
from grs_agents.perception.shapes.types import ObjectMesh, ObjectView, make_object_view
from grs_agents.perception.types import Aabb, CandidateRecord, Mask, UprightBox
from grs_agents.toolkit import ToolContext, load_tool
from tests.perception.settling.photo import photo_of

RED = (0.8, 0.1, 0.1)
BOX = UprightBox(center=(0.5, 0.05, 0.05), size=(0.12, 0.04, 0.1), yaw=0.4)
STUB = '''"""A model of one's own."""
from dataclasses import dataclass
from pathlib import Path

from grs_agents.perception.shapes import MeshFile, ObjectView


@dataclass(frozen=True)
class Request:
    view: ObjectView
    folder: Path
    model: str | None = None


@dataclass(frozen=True)
class Result:
    shape: MeshFile


def run(request, context):
    assert request.view.mask.any()
    return Result(MeshFile(Path(request.model)))
'''


def angle() -> trimesh.Trimesh:
    """A thing like an L that fills the box, about the middle of its foot."""
    lying, upright = trimesh.creation.box((0.12, 0.04, 0.03)), trimesh.creation.box((0.03, 0.04, 0.1))
    lying.apply_translation((0.0, 0.0, 0.015))
    upright.apply_translation((0.045, 0.0, 0.05))
    faces = np.concatenate([lying.faces, np.asarray(upright.faces) + 8])
    return trimesh.Trimesh(np.concatenate([lying.vertices, upright.vertices]), faces, process=False)


@pytest.fixture
def seen(tmp_path: Path) -> tuple[Photo, Mask, ObjectView]:
    """The thing in a photo."""
    mesh = angle()
    vertices = np.asarray(mesh.vertices, np.float64)
    look = ObjectMesh(
        vertices, np.asarray(mesh.faces, np.int64), np.zeros((16, 2)), np.full((4, 4, 3), (200, 30, 30), np.uint8)
    )
    write_proxy(tmp_path, "angle", Proxy(look, (Hull(vertices[:8]), Hull(vertices[8:])), False, RED), "a thing")
    turn = (0.0, 0.0, float(np.sin(0.2)), float(np.cos(0.2)))
    frame, table, mask = photo_of([PlacedObject("proxy/angle.urdf", (BOX.center, turn))], Library(tmp_path))
    return (frame, table), mask, make_object_view(frame, table, mask, BOX, 0.001)


def mesh_file(folder: Path, view: ObjectView, frame: Literal["object", "camera"], suffix: str) -> MeshFile:
    """The thing in a file, larger and elsewhere, turned about the vertical or as the camera sees it."""
    mesh = angle()
    turn = rotation_about_z(1.9) if frame == "object" else view.T_object_cam[:3, :3].T
    turn = UP_TO_Z["y"].T @ turn if suffix == ".glb" else turn
    vertices = np.asarray(mesh.vertices) @ turn.T * 37 + np.array((5.0, -3.0, 1.0))
    green = np.tile((30, 200, 30, 255), (len(mesh.faces), 1))
    trimesh.Trimesh(vertices, mesh.faces, face_colors=green, process=False).export(folder / f"model{suffix}")
    return MeshFile(folder / f"model{suffix}", frame)


@pytest.mark.parametrize(("frame", "suffix"), [("object", ".glb"), ("object", ".ply"), ("camera", ".ply")])
def test_a_mesh_of_any_size_and_turn_is_laid_onto_what_was_measured(
    tmp_path: Path, seen: tuple[Photo, Mask, ObjectView], frame: Literal["object", "camera"], suffix: str
) -> None:
    _, _, view = seen
    shape = fit_mesh_file(mesh_file(tmp_path, view, frame, suffix), view)
    assert shape is not None and shape.method == "model"
    assert shape.silhouette_iou > 0.9 and shape.depth_error < 0.008
    assert np.ptp(shape.mesh.vertices, axis=0) == pytest.approx(BOX.size, abs=0.006)
    assert shape.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    green = 229 if suffix == ".glb" else 200  # vertex colours of glTF are linear
    assert shape.mesh.texture.reshape(-1, 3)[:, 1].max() == green


@pytest.fixture
def services(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Services]:
    """As much of the services as a shape needs, with a tool of the user's own."""
    monkeypatch.setattr(content, "_overlays", [])
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "shape_stub.py").write_text(STUB)
    content.add_overlay_folder(tmp_path)
    tools, shape = SimpleNamespace(shape="shape_stub"), SimpleNamespace(model=str(tmp_path / "model.ply"))

    def run_tool(name: str, **request: Any) -> Any:
        tool = load_tool(name)
        return tool.run(tool.Request(**request), cast(ToolContext, None))

    config = SimpleNamespace(tools=tools, shape=shape)
    yield cast(Services, SimpleNamespace(folder=tmp_path, config=config, run_tool=run_tool))
    sys.modules.pop("grs_content.tools.shape_stub", None)


def test_a_tool_of_one_s_own_stands_for_the_object_with_colliders_that_fit(
    tmp_path: Path, seen: tuple[Photo, Mask, ObjectView], services: Services
) -> None:
    photo, mask, view = seen
    cv2.imwrite(str(tmp_path / "mask.png"), mask.astype(np.uint8) * 255)
    record = CandidateRecord(
        id=1,
        mask="mask.png",
        crop="mask.png",
        box=Aabb(low=(0.4, 0.0, 0.0), high=(0.6, 0.1, 0.1)),
        upright=BOX,
        color=RED,
        shape="box",
        points=500,
    )
    with pytest.raises(InputError, match=r"model\.ply"):
        reconstruct_proxy(record, BOX, "box", mask, photo, services)
    mesh_file(tmp_path, view, "object", ".ply")
    proxy = reconstruct_proxy(record, BOX, "box", mask, photo, services)
    asset = write_proxy(tmp_path, "ours", proxy, "a thing")
    model = Library(tmp_path).load_object_model(asset.name)
    assert asset.size == pytest.approx(BOX.size, abs=0.008)
    assert 2 <= len(model.colliders) <= 6
