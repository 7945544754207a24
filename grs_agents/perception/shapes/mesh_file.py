"""Mesh of an object from the user's own model: scaled, turned and registered to the measured points."""

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
from grs_agents.perception.asset_surfaces import RegistrationCloud, align_point_clouds, sample_triangle_points
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.object_crop import crop_object
from grs_agents.perception.shapes.types import ObjectMesh, ObjectShape, ObjectView
from grs_agents.perception.shapes.view_fit import compare_mesh_with_photo
from grs_agents.perception.types import Array

CONFIG = DEFAULT.mesh_file


@dataclass(frozen=True)
class MeshFile:
    """A mesh of an object, of any scale."""

    path: Path  # OBJ, GLB, glTF, STL, PLY, DAE or MSH, with its pictures beside it
    # axes: ``object``, upright as its format says, else z up, of any yaw;
    # or ``camera``, those of the photo's camera (OpenCV: x right, y down, z forward)
    frame: Literal["object", "camera"] = "object"

    def read_simplified(self) -> ObjectMesh:
        """The mesh in its file's units, simplified like reconstructed shapes; in the object's axes z is up."""
        limits = ImportOptions().limits
        read = read_mesh(SourceFolder(self.path.parent, limits.bytes), self.path.name, limits)
        solid, _ = simplify_textured_mesh(merge_mesh_parts(read.parts, CONFIG.texture), CONFIG.faces, CONFIG.texture)
        up = read.up if self.frame == "object" and read.up != "auto" else "z"
        corners: Array = np.column_stack([solid.faces.ravel(), solid.uvs.reshape(-1, 2).round(5)]).astype(np.float64)
        kept, number = np.unique(corners, axis=0, return_inverse=True)
        vertices = solid.vertices[kept[:, 0].astype(np.int64)] @ UP_TO_Z[up].T
        return ObjectMesh(vertices, number.reshape(-1, 3), kept[:, 1:], solid.image)


def fit_mesh_file(source: MeshFile, view: ObjectView) -> ObjectShape | None:
    """The shape in a mesh file, placed at the measured pose and size; ``None`` with too little measured depth.

    Raises:
        InputError: the file cannot be read.
    """
    crop = crop_object(view)
    if crop is None:
        return None
    mesh = source.read_simplified()
    upright = view.T_object_cam[:3, :3] if source.frame == "camera" else np.eye(3)
    count = 1 if source.frame == "camera" else CONFIG.yaws
    yaws = np.arange(count) * 2 * np.pi / count
    placed: list[Array] = []
    for yaw in yaws:
        vertices = mesh.vertices @ (rotation_about_z(float(yaw)) @ upright).T
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        scale = math.prod((np.array(view.size) / np.maximum(high - low, 1e-9)).tolist()) ** (1 / 3)
        placed.append((vertices - (*((low + high) / 2)[:2], low[2])) * scale)  # as large as its box, on the support

    def score(vertices: Array) -> float:
        agreement = compare_mesh_with_photo(crop, vertices, mesh.faces)
        return agreement.overlap - min(agreement.raw_error / CONFIG.worth, 1.0)

    def register(vertices: Array) -> Array:
        """Vertices (V, 3) registered to the seen points, and kept on the support."""
        for reach in CONFIG.reach:
            points = sample_triangle_points(vertices[mesh.faces], CONFIG.samples, np.random.default_rng(0)).points
            cloud, target = RegistrationCloud(points), RegistrationCloud(crop.points)
            move = np.linalg.inv(align_point_clouds(cloud, target, np.eye(4), reach))
            vertices = vertices @ move[:3, :3].T + move[:3, 3]
            vertices = vertices - np.array((0.0, 0.0, float(vertices[:, 2].min())))
        return vertices

    likely = sorted(placed, key=lambda vertices: -score(vertices))[: CONFIG.refined]
    tried = [register(vertices * scale) for vertices in likely for scale in CONFIG.scales]
    best = max([*likely, *tried], key=score)
    agreement = compare_mesh_with_photo(crop, best, mesh.faces)
    final = ObjectMesh(best, mesh.faces, mesh.uvs, mesh.texture)
    return ObjectShape(
        final, "model", hollow=False, walls=None, silhouette_iou=agreement.overlap, depth_error=agreement.raw_error
    )
