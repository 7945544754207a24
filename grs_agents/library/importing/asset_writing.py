"""Writing a prepared asset into a library: URDF, OBJ, PNG, convex parts, views, and its entry."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grs_agents.base.files import write_bytes
from grs_agents.library.asset import Asset
from grs_agents.library.asset_rendering import render_random_views
from grs_agents.library.formats.model_file import MAX_PARTS
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.importing.types import Collider, ConvexHull, TexturedMesh
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import box_inertia, encode_png, format_obj_text
from grs_agents.library.shapes import Shape


def write_asset_files(root: Path, asset: Asset, solid: TexturedMesh, colliders: Sequence[Collider]) -> Asset:
    """Write all files of an asset below the library ``root``; its entry, which is not in the manifest yet."""
    collection, _, file = asset.name.rpartition("/")
    files = _build_asset_files(collection, file.removesuffix(".urdf"), asset, solid, colliders)
    for number in range(sum(isinstance(collider, ConvexHull) for collider in colliders), MAX_PARTS):
        (root / f"{collection}/meshes/{asset.kind}.part{number}.obj").unlink(missing_ok=True)  # of an earlier import
    for name, data in files.items():
        write_bytes(root / name, data)
    for number, view in enumerate(render_random_views(Library(root), asset.name)):
        write_bytes(asset_view_path(root, asset.name, number), encode_png(view.rgba))
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    return asset.model_copy(update={"origin": asset.origin and asset.origin.model_copy(update={"files": digests})})


def _build_asset_files(
    collection: str, slug: str, asset: Asset, solid: TexturedMesh, colliders: Sequence[Collider]
) -> dict[str, bytes]:
    """The content of each file of an asset, by library-relative name."""
    base, texture = f"{collection}/meshes/{slug}", f"{collection}/textures/{slug}.png"
    uvs, number = np.unique(np.round(solid.uvs.reshape(-1, 2), 5), axis=0, return_inverse=True)
    mesh = format_obj_text(solid.vertices, solid.faces, uvs, number.reshape(-1, 3))
    files = {f"{base}.obj": mesh.encode(), texture: encode_png(solid.image)}
    hulls = [collider for collider in colliders if isinstance(collider, ConvexHull)]
    for number, hull in enumerate(hulls):
        files[f"{base}.part{number}.obj"] = format_obj_text(hull.vertices, hull.faces).encode()
    seen = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj", texture=texture, color=(1.0, 1.0, 1.0, 1.0))
    touching = [collider for collider in colliders if isinstance(collider, Shape)]
    touching += [Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj")] if hulls else []
    inertia = box_inertia(asset.size, asset.mass)
    text = format_urdf_text(
        slug, [seen], touching, mass=asset.mass, friction=asset.friction, inertia=inertia, folder=collection
    )
    return files | {asset.name: text.encode()}


def asset_view_path(root: Path, name: str, number: int) -> Path:
    """Where the picture of an asset's random view ``number`` lies."""
    urdf = root / name
    return urdf.parent / "views" / f"{urdf.stem}-{number}.png"
