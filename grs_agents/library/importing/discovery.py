"""What assets a folder holds: known layouts first, then descriptions, then loose meshes."""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Final

from grs_agents.library.importing.appearance import HOPE_LICENSE, OPEN_LICENSE
from grs_agents.library.importing.mesh_reader import SUFFIXES
from grs_agents.library.importing.source_folder import Folder, mtl_pictures
from grs_agents.library.importing.types import Item, RefusedError

_PREFERRED: Final = (".glb", ".gltf", ".obj", ".dae", ".ply", ".stl", ".msh")
_COLLISION: Final = re.compile(r"(_coll?|_collision|_ch|_vis|\.part\d+|_convex.*|coacd.*|vhacd.*)$", re.IGNORECASE)
_YCB: Final = re.compile(r"^\d{3}(-[a-z])?_\w+$")
_YCB_FILES: Final = (
    "google_16k/textured.obj", "google_64k/textured.obj", "google_512k/textured.obj", "tsdf/textured.obj",
    "poisson/textured.obj", "textured_simple.obj", "textured.obj",
    "google_16k/nontextured.ply", "google_16k/nontextured.stl",
)  # fmt: skip
_FILES: Final = re.compile(r"""(?:filename|file)\s*=\s*["']([^"']+)["']""")
_HOPE: Final = "stable_hope_objects"
_MOST: Final = 1_000_000
_HEAD: Final = 2000


def find_items(folder: Folder) -> list[Item]:
    """The assets of a folder, in the order of their paths, each with a name of its own."""
    names = list(_walk(folder.root))
    claimed: set[str] = set()
    items: list[Item] = []
    for found in (_hope(names), _gso(names), _ycb(names), _described(folder, names, claimed)):
        items += [item for item in found if not _inside(item.file, claimed)]
        claimed |= {item.file for item in items}
        claimed |= {f"{_home(item)}/" for item in items if item.kind in ("gso", "ycb")}
        claimed |= {f"{_set_of(item.file)}/" for item in items if item.kind == "hope"}
    items += list(_meshes(names, claimed))
    return _named_once(sorted(items, key=lambda item: item.file))


def item_files(folder: Folder, item: Item) -> tuple[str, ...]:
    """All files that an item is made of, as far as they can be found; what is wrong with them is said on reading."""
    found = {item.file, *([item.texture] if item.texture else []), *item.files}
    for name in tuple(found):
        if name.lower().endswith(".obj"):
            try:
                materials, pictures = mtl_pictures(folder, name)
            except RefusedError:
                continue
            found |= {*materials, *pictures}
    return tuple(sorted(found))


def slug_of(name: str) -> str:
    """A name as files and programs can bear it: letters, digits, ``_`` and ``-``, at most 64."""
    slug = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-")[:64]
    return slug if re.match(r"[A-Za-z0-9]", slug) else f"asset_{slug}".rstrip("_")


def _walk(root: Path) -> Iterator[str]:
    """Every file below ``root`` by its relative name, hidden ones and links left out."""
    for path in sorted(islice(root.rglob("*"), _MOST)):
        relative = path.relative_to(root)
        if path.is_file() and not path.is_symlink() and not any(part.startswith(".") for part in relative.parts):
            yield relative.as_posix()


def _inside(file: str, claimed: set[str]) -> bool:
    return file in claimed or any(f"{parent}/" in claimed for parent in PurePosixPath(file).parents)


def _home(item: Item) -> str:
    """The folder that belongs to an item of a known layout."""
    parts = PurePosixPath(item.file).parts
    depth = 2 if item.kind == "gso" or not _YCB.match(parts[-2]) else 1
    return "/".join(parts[:-depth])


def _set_of(file: str) -> str:
    """The folder of the HOPE set that a file belongs to; its recoloured copies are in it too."""
    parts = PurePosixPath(file).parts
    return "/".join(parts[: parts.index(_HOPE) + 1])


def _hope(names: list[str]) -> Iterator[Item]:
    """The HOPE meshes as LIBERO packages them, ``stable_hope_objects/KIND``, without their recoloured copies."""
    homes: dict[str, list[str]] = {}
    for name in names:
        parts = PurePosixPath(name).parts
        if _HOPE in parts[:-2]:
            at = parts.index(_HOPE)
            homes.setdefault("/".join(parts[: at + 2]), []).append(name)
    kinds = {PurePosixPath(home).name for home in homes}
    for home, files in homes.items():
        kind = PurePosixPath(home).name
        if "_" in kind and kind.partition("_")[2] in kinds:
            continue
        direct = [one for one in files if one.endswith(".obj") and not _COLLISION.search(PurePosixPath(one).stem)]
        binary = [one for one in files if one.endswith(".msh")]
        texture = next((one for one in files if one.endswith("/texture_map.png")), None)
        if chosen := [one for one in direct if one.count("/") == home.count("/") + 1] or binary:
            yield Item(kind="hope", name=kind, file=chosen[0], texture=texture, license=HOPE_LICENSE)


def _gso(names: list[str]) -> Iterator[Item]:
    known = set(names)
    for name in names:
        if name.endswith("meshes/model.obj"):
            home = name.removesuffix("meshes/model.obj")
            picture = f"{home}materials/textures/texture.png"
            title = PurePosixPath(home).name or "model"
            yield Item(
                kind="gso",
                name=title,
                file=name,
                files=tuple(one for one in (f"{home}metadata.pbtxt",) if one in known),
                texture=picture if picture in known else None,
                license=OPEN_LICENSE,
            )


def _ycb(names: list[str]) -> Iterator[Item]:
    known = set(names)
    homes = {
        "/".join(parts[: at + 1])
        for parts in (PurePosixPath(name).parts for name in names)
        for at, part in enumerate(parts[:-1])
        if _YCB.match(part)
    }
    for home in sorted(homes):
        file = next((f"{home}/{one}" for one in _YCB_FILES if f"{home}/{one}" in known), None)
        if file is not None:
            yield Item(kind="ycb", name=PurePosixPath(home).name, file=file, license=OPEN_LICENSE)


def _described(folder: Folder, names: list[str], claimed: set[str]) -> Iterator[Item]:
    """URDF and MJCF files; the meshes that they name are theirs, and those beside the only one of a folder."""
    described = [name for name in names if PurePosixPath(name).suffix.lower() in (".urdf", ".xml", ".mjcf")]
    for name in described:
        suffix = PurePosixPath(name).suffix.lower()
        if _inside(name, claimed):
            continue
        with (folder.root / name).open(encoding="utf-8", errors="replace") as file:
            head = file.read(_HEAD)
            if suffix != ".urdf" and "<mujoco" not in head:
                continue
            text = head + file.read(_MOST)
        told = {PurePosixPath(one).name for one in _FILES.findall(text)}
        parts = [one for one in names if PurePosixPath(one).name in told and _related(one, name)]
        claimed |= set(parts)
        home = PurePosixPath(name).parent.as_posix()
        if home != "." and sum(PurePosixPath(one).parent.as_posix() == home for one in described) == 1:
            claimed |= {one for one in names if one.startswith(f"{home}/") and one not in described}
        kind = "urdf" if suffix == ".urdf" else "mjcf"
        yield Item(kind=kind, name=PurePosixPath(name).stem, file=name, files=tuple(parts))


def _related(file: str, description: str) -> bool:
    """Whether a file lies below the folder of a description or below the folder around it."""
    home = PurePosixPath(description).parent
    return any(PurePosixPath(file).is_relative_to(one) for one in (home, home.parent))


def _meshes(names: list[str], claimed: set[str]) -> Iterator[Item]:
    loose: dict[str, list[str]] = {}
    for name in names:
        pure = PurePosixPath(name)
        if pure.suffix.lower() in SUFFIXES and not _inside(name, claimed):
            loose.setdefault((pure.parent / pure.stem).as_posix(), []).append(name)
    for stem, files in loose.items():
        pure = PurePosixPath(stem)
        main = _COLLISION.sub("", stem)
        if main != stem and main in loose:
            continue
        file = min(files, key=lambda one: _PREFERRED.index(PurePosixPath(one).suffix.lower()))
        plain = pure.name.lower() in ("model", "mesh", "textured", "object", "scene", "untitled") and pure.parent.name
        yield Item(kind="mesh", name=pure.parent.name if plain else pure.name, file=file)


def _named_once(items: list[Item]) -> list[Item]:
    taken: set[str] = set()
    named: list[Item] = []
    for item in items:
        slug = base = slug_of(item.name)
        number = 2
        while slug.lower() in taken:
            slug, number = f"{base[:60]}-{number}", number + 1
        taken.add(slug.lower())
        named.append(item.model_copy(update={"name": slug}))
    return named
