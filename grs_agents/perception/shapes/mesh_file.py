"""The mesh of an object that a model of one's own made: scaled, turned and laid onto what was measured."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from grs_agents.base.geometry.transforms import rotation_about_z
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.mesh_simplification import simplify_textured_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import merge_mesh_parts
from grs_agents.library.importing.types import UP_TO_Z, ImportOptions
from grs_agents.perception.asset_surfaces import Cloud, align_point_clouds, sample_triangle_points
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import compare_mesh_with_photo
from grs_agents.perception.shapes.observation import Observation, observe_object
from grs_agents.perception.shapes.types import ObjectShape, ObjectView, TexturedMesh
from grs_agents.perception.types import Array

CONFIG = DEFAULT.mesh_file


@dataclass(frozen=True)
class MeshFile:
    """A mesh of one object; its scale does not matter."""

    path: Path  # OBJ, GLB, glTF, STL, PLY, DAE or MSH, with its pictures beside it
    # the axes it is told in: ``object``, upright as its format says, else z up, turned about that in any way;
    # or ``camera``, those of the photo's camera (OpenCV: x right, y down, z forward)
    frame: Literal["object", "camera"] = "object"


def fit_mesh_file(found: MeshFile, view: ObjectView) -> ObjectShape | None:
    """The shape in a mesh file where a view shows it, as large as it was measured; ``None`` if too little was measured.

    Raises:
        InputError: the file cannot be read.
    """
    seen = observe_object(view)
    if seen is None:
        return None
    mesh = _read_simplified_mesh(found)
    upright = view.T_object_cam[:3, :3] if found.frame == "camera" else np.eye(3)
    count = 1 if found.frame == "camera" else CONFIG.yaws
    yaws = np.arange(count) * 2 * np.pi / count
    placed = [
        _scale_and_center_on_support(mesh.vertices @ (rotation_about_z(float(yaw)) @ upright).T, view.size)
        for yaw in yaws
    ]
    likely = sorted(placed, key=lambda vertices: -_score_against_view(seen, vertices, mesh))[: CONFIG.refined]
    tried = [_align_to_seen_points(seen, vertices * scale, mesh) for vertices in likely for scale in CONFIG.scales]
    best = max([*likely, *tried], key=lambda vertices: _score_against_view(seen, vertices, mesh))
    agreed = compare_mesh_with_photo(seen, best, mesh.faces)
    final = TexturedMesh(best, mesh.faces, mesh.uvs, mesh.texture)
    return ObjectShape(
        final, "model", hollow=False, walls=None, silhouette_iou=agreed.overlap, depth_error=agreed.raw_error
    )


def _read_simplified_mesh(found: MeshFile) -> TexturedMesh:
    """The mesh in its file's units, about as fine as shapes are; in the object's axes z is up."""
    limits = ImportOptions().limits
    source = read_mesh(SourceFolder(found.path.parent, limits.bytes), found.path.name, limits)
    solid, _ = simplify_textured_mesh(merge_mesh_parts(source.parts, CONFIG.texture), CONFIG.faces, CONFIG.texture)
    up = source.up if found.frame == "object" and source.up != "auto" else "z"
    corners: Array = np.column_stack([solid.faces.ravel(), solid.uvs.reshape(-1, 2).round(5)]).astype(np.float64)
    kept, number = np.unique(corners, axis=0, return_inverse=True)
    vertices = solid.vertices[kept[:, 0].astype(np.int64)] @ UP_TO_Z[up].T
    return TexturedMesh(vertices, number.reshape(-1, 3), kept[:, 1:], solid.image)


def _scale_and_center_on_support(vertices: Array, size: tuple[float, float, float]) -> Array:
    """Vertices on the support in the middle of the object's box, as large as it in all."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scale = math.prod((np.array(size) / np.maximum(high - low, 1e-9)).tolist()) ** (1 / 3)
    return (vertices - (*((low + high) / 2)[:2], low[2])) * scale


def _align_to_seen_points(seen: Observation, vertices: Array, mesh: TexturedMesh) -> Array:
    """Vertices moved so that their surface lies on the seen points; they stay on the support."""
    for reach in CONFIG.reach:
        points = sample_triangle_points(vertices[mesh.faces], CONFIG.samples, np.random.default_rng(0)).points
        move = np.linalg.inv(align_point_clouds(Cloud(points), Cloud(seen.points), np.eye(4), reach))
        vertices = vertices @ move[:3, :3].T + move[:3, 3]
        vertices = vertices - np.array((0.0, 0.0, float(vertices[:, 2].min())))
    return vertices


def _score_against_view(seen: Observation, vertices: Array, mesh: TexturedMesh) -> float:
    """How well a mesh agrees with the view: its silhouette's overlap, less what its depth is off."""
    agreed = compare_mesh_with_photo(seen, vertices, mesh.faces)
    return agreed.overlap - min(agreed.raw_error / CONFIG.worth, 1.0)
