"""The twin's objects as glTF for the page."""

from typing import Any, Final

import numpy as np
import trimesh
from PIL import Image as Pictures
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from grs_agents.library.asset_rendering import build_textured_triangles
from grs_agents.library.library import Library

_TEXTURE_SIDE: Final = 256  # px; a page of 20 objects stays below 10 MB


def build_asset_glb(library: Library, asset: str) -> bytes:
    """The visible triangles of an asset in its own frame, as binary glTF.

    Raises:
        InputError: its files are faulty.
    """
    model = library.load_object_model(asset)
    painted = build_textured_triangles(library, model.visuals or model.colliders)
    scene: Any = trimesh.Scene()
    for number in sorted(set(map(int, painted.texture))):
        part = painted.texture == number
        corners = painted.corners[part].reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        mesh: Any = trimesh.Trimesh(corners, faces, process=False)
        if number < 0:
            colors = np.repeat(painted.colors[part], 3, axis=0)
            opaque = np.full((len(corners), 1), 255, np.uint8)
            colored = np.hstack([np.rint(colors * 255).astype(np.uint8), opaque])
            mesh.visual = ColorVisuals(mesh, vertex_colors=colored)
        else:
            picture = Pictures.fromarray(painted.textures[number])
            picture.thumbnail((_TEXTURE_SIDE, _TEXTURE_SIDE))
            material: Any = PBRMaterial(
                baseColorTexture=picture,
                metallicFactor=0.0,
                roughnessFactor=0.9,
            )
            mesh.visual = TextureVisuals(uv=painted.uvs[part].reshape(-1, 2), material=material)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))
