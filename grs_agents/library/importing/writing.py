"""Writing a prepared thing into a library: URDF, OBJ, PNG, convex parts, views, and its entry."""

import hashlib
from pathlib import Path

import numpy as np

from grs_agents.files import write_bytes
from grs_agents.library.asset import Asset, Origin
from grs_agents.library.asset_views import asset_views, random_directions
from grs_agents.library.formats.model_file import MAX_PARTS
from grs_agents.library.formats.urdf import urdf_text
from grs_agents.library.importing.preparation import Prepared
from grs_agents.library.importing.types import Hull, Item
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import obj_text, png_bytes
from grs_agents.library.shapes import Shape

VIEWS = 3
"""Random views of each asset, as in the paper."""
VIEW_SIZE = 384


def write_prepared(root: Path, collection: str, item: Item, thing: Prepared, content: str, license_: str) -> Asset:
    """Write all files of a thing below ``root`` and return its entry, which is not in the manifest yet.

    Args:
        root: of the library.
        collection: folder of the library.
        item: what it was made from.
        thing: what to write.
        content: SHA-256 of the source files.
        license_: of the source.

    Raises:
        InputError: the folder cannot be written.
    """
    name, physics = f"{collection}/{item.name}.urdf", thing.physics
    files = _files(collection, item.name, thing)
    for number in range(sum(isinstance(one, Hull) for one in thing.colliders), MAX_PARTS):
        (root / f"{collection}/meshes/{item.name}.part{number}.obj").unlink(missing_ok=True)  # of an earlier import
    for file, data in files.items():
        write_bytes(root / file, data)
    _write_views(root, collection, item.name)
    return Asset(
        name=name,
        kind=item.name,
        category=thing.category,
        size=thing.size,
        mass=physics.mass.value,
        friction=physics.friction.value,
        color=thing.colors[0],
        description=thing.description,
        hollow=thing.hollow,
        physics=physics,
        origin=Origin(
            collection=collection,
            source=item.file,
            license=license_,
            content=content,
            shape=thing.shape,
            look=thing.look,
            files={file: hashlib.sha256(data).hexdigest() for file, data in files.items()},
            notes=thing.notes,
        ),
    )


def _files(collection: str, slug: str, thing: Prepared) -> dict[str, bytes]:
    """The content of each file of a thing, by library-relative name."""
    base, texture = f"{collection}/meshes/{slug}", f"{collection}/textures/{slug}.png"
    solid = thing.solid
    uvs, number = np.unique(np.round(solid.uvs.reshape(-1, 2), 5), axis=0, return_inverse=True)
    mesh = obj_text(solid.vertices, solid.faces, uvs, number.reshape(-1, 3))
    files: dict[str, bytes] = {f"{base}.obj": mesh.encode(), texture: png_bytes(solid.image)}
    hulls = [one for one in thing.colliders if isinstance(one, Hull)]
    for number, hull in enumerate(hulls):
        files[f"{base}.part{number}.obj"] = obj_text(hull.vertices, hull.faces).encode()
    seen = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj", texture=texture, color=(1.0, 1.0, 1.0, 1.0))
    touching = [one for one in thing.colliders if isinstance(one, Shape)]
    touching += [Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj")] if hulls else []
    text = urdf_text(
        slug,
        [seen],
        touching,
        mass=thing.physics.mass.value,
        friction=thing.physics.friction.value,
        inertia=thing.inertia,
        folder=collection,
    )
    return files | {f"{collection}/{slug}.urdf": text.encode()}


def view_path(root: Path, name: str, number: int) -> Path:
    """Where the picture of an asset's random view ``number`` lies."""
    urdf = root / name
    return urdf.parent / "views" / f"{urdf.stem}-{number}.png"


def _write_views(root: Path, collection: str, slug: str) -> None:
    """The random views, the same for the same name."""
    name = f"{collection}/{slug}.urdf"
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    library = Library(root)
    views = asset_views(library, name, random_directions(VIEWS, np.random.default_rng(seed)), size=VIEW_SIZE)
    for number, view in enumerate(views):
        write_bytes(view_path(root, name, number), png_bytes(view.rgba))
