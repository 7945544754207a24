"""Assets of a folder: known layouts first, then descriptions, then loose meshes."""

import re
import unicodedata
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import PurePosixPath
from typing import Final
from urllib.parse import unquote

from grs_agents.base.errors import InputError
from grs_agents.library.importing.gltf_document import find_gltf_files
from grs_agents.library.importing.mesh_appearance import HOPE_LICENSE, OPEN_LICENSE
from grs_agents.library.importing.mesh_reader import SUFFIXES
from grs_agents.library.importing.obj_reader import find_obj_material_files
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportOutcome, Kind, RefusedError, SourceItem

DESCRIPTIONS: Final[dict[str, Kind]] = {".urdf": "urdf", ".sdf": "urdf", ".xml": "mjcf", ".mjcf": "mjcf"}
_BLENDER: Final = "open it in Blender and export GLB"
_CAD: Final = "export GLB or STL from a CAD program, e.g. FreeCAD"
_POINTS: Final = "make a mesh of the points, e.g. with MeshLab, and save it as PLY"
_UNPACK: Final = "unpack it and import the folder"
UNREAD: Final[dict[str, tuple[str, str]]] = {
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), ("USD", _BLENDER)),
    ".fbx": ("FBX", _BLENDER),
    ".blend": ("a Blender scene", _BLENDER),
    ".3ds": ("3D Studio", _BLENDER),
    **dict.fromkeys((".x3d", ".wrl", ".vrml"), ("X3D or VRML", _BLENDER)),
    **dict.fromkeys((".abc", ".lwo", ".lws", ".ac", ".ase", ".x", ".b3d"), ("a scene", _BLENDER)),
    **dict.fromkeys(
        (".max", ".ma", ".mb", ".c4d", ".skp", ".3dm"), ("a scene", "export GLB from the program it is of")
    ),
    **dict.fromkeys((".step", ".stp"), ("STEP", _CAD)),
    **dict.fromkeys((".iges", ".igs"), ("IGES", _CAD)),
    **dict.fromkeys((".brep", ".fcstd", ".sldprt", ".sldasm", ".ipt", ".iam", ".f3d", ".x_t", ".jt"), ("CAD", _CAD)),
    ".amf": ("AMF", "save it as STL or 3MF from a slicer"),
    ".zae": ("a packed DAE", "rename it to .zip and unpack it"),
    **dict.fromkeys((".pcd", ".xyz", ".pts", ".las", ".laz", ".e57", ".splat"), ("points", _POINTS)),
    ".xacro": ("a macro of a URDF", "run: xacro FILE > FILE.urdf"),
    ".world": ("a Gazebo world", "import the models that it names"),
    **dict.fromkeys((".7z", ".rar", ".gz", ".bz2", ".xz", ".zst"), ("an archive", _UNPACK)),
}
"""Unsupported model formats: name of the format, and a way to a supported format."""
ARCHIVE_SUFFIXES: Final = (".zip", ".whl", ".tgz", ".tar.gz", ".tar")
"""Archives that are unpacked if they lie in the source itself."""
_PREFERRED: Final = (".glb", ".gltf", ".obj", ".dae", ".ply", ".3mf", ".stl", ".off", ".msh")
_COLLISION: Final = re.compile(r"(_coll?|_collision|_ch|_vis|\.part\d+|_convex.*|coacd.*|vhacd.*)$", re.IGNORECASE)
_UNTOLD: Final = ("model", "mesh", "textured", "object", "scene", "untitled")
"""Names of mesh files that say nothing: the folder's name is taken."""
_YCB: Final = re.compile(r"^\d{3}(-[a-z])?_\w+$")
_YCB_FOLDERS: Final = ("google_16k/", "google_64k/", "google_512k/", "tsdf/", "poisson/")
_YCB_FILES: Final = (
    *(f"{folder}textured.obj" for folder in _YCB_FOLDERS),
    *("textured_simple.obj", "textured.obj", "google_16k/nontextured.ply", "google_16k/nontextured.stl"),
)
_FILES: Final = re.compile(r"""(?:filename|file)\s*=\s*["']([^"']+)["']|<(?:uri|albedo_map)>([^<]*)</""")
_CONFIG: Final = "model.config"
"""File of Gazebo beside the versions of a model."""
_CONFIGURED: Final = re.compile(r"""<sdf(?:\s+version\s*=\s*["']([\d.]{1,40})["'])?\s*>([^<]*)</sdf>""")
_HOPE: Final = "stable_hope_objects"
_MOST: Final = 1_000_000
_TITLE: Final = 120
_HEAD: Final = 2000
_MOST_NAMESAKES: Final = 5_000_000
"""Pairs of a description and a file of a name that it mentions: 1,300 folders with three meshes of the same names."""
MOST_ITEMS: Final = 5000
"""Assets of a source. Each takes seconds; the largest usual set, Google Scanned Objects, has 1,030."""


def find_source_items(folder: SourceFolder) -> list[SourceItem]:
    """The assets of a folder, in the order of their paths, each with a name of its own."""
    return survey_folder(folder)[0]


def survey_folder(folder: SourceFolder) -> tuple[list[SourceItem], list[ImportOutcome]]:
    """The assets of a folder as `find_source_items`, and the models that are passed over, each with the reason.
    Raises InputError: there are more than `MOST_ITEMS` assets."""
    paths = [path for path in sorted(islice(folder.root.rglob("*"), _MOST)) if path.is_file() and not path.is_symlink()]
    relative = [path.relative_to(folder.root) for path in paths]
    names = [path.as_posix() for path in relative if not any(part.startswith(".") for part in path.parts)]
    claimed: set[str] = set()
    beside: dict[str, str] = {}
    items: list[SourceItem] = []
    known = (_find_hope_items(names), _find_gso_items(names), _find_ycb_items(names))
    for layout in (*known, _find_urdf_and_mjcf_items(folder, names, claimed, beside)):
        items += [item for item in layout if not _belongs_to_claimed_item(item.file, claimed)]
        claimed |= {item.file for item in items}
        for item in items:  # of a known layout; its folder is claimed, for HOPE that of the set with its copies
            if item.kind in ("gso", "ycb", "hope"):
                parts = PurePosixPath(item.file).parts
                nested = item.kind == "gso" or not _YCB.match(parts[-2])
                depth = parts.index(_HOPE) + 1 if item.kind == "hope" else -2 if nested else -1
                claimed.add("/".join(parts[:depth]) + "/")
    loose: dict[str, list[str]] = {}  # meshes without a description: for each name the file in the richest format
    for name in names:
        if _lower_suffix(name) in SUFFIXES and not _belongs_to_claimed_item(name, claimed):
            loose.setdefault(PurePosixPath(name).with_suffix("").as_posix(), []).append(name)
    for stem, meshes in loose.items():
        main = _COLLISION.sub("", stem)
        if main == stem or main not in loose:
            file = min(meshes, key=lambda file: _PREFERRED.index(_lower_suffix(file)))
            items.append(SourceItem(kind="mesh", name=_name_that_tells(PurePosixPath(file)), file=file))
    if len(items) > MOST_ITEMS:
        message = f"{folder.root.name} holds {len(items)} assets; an import takes at most {MOST_ITEMS}"
        raise InputError(message, "import it in parts")
    files = {file for item in items for file in (item.file, *item.files)}
    unread = {
        name: "it is {}; {}".format(*UNREAD[kind])
        for name in names
        if (kind := _lower_suffix(name)) in UNREAD
        and ("/" in name or not name.lower().endswith(ARCHIVE_SUFFIXES))  # which the import itself unpacks or refuses
    }
    unread |= {
        name: f"it lies beside {main}, which does not name it; import it by itself"
        for name, main in beside.items()
        if name not in files and _lower_suffix(name) in SUFFIXES
    }
    outcomes = [
        ImportOutcome(item=PurePosixPath(name).name, source=name, status="unread", reason=reason)
        for name, reason in sorted(unread.items())
    ]
    taken: set[str] = set()
    named: list[SourceItem] = []
    for item in sorted(items, key=lambda item: item.file):
        slug = base = slugify_name(item.name)
        number = 2
        while slug.lower() in taken:
            slug, number = f"{base[:60]}-{number}", number + 1
        taken.add(slug.lower())
        title = "".join(letter if letter.isprintable() else " " for letter in item.name)[:_TITLE]
        named.append(item.model_copy(update={"name": slug, "title": title}))
    return named, outcomes


def find_item_files(folder: SourceFolder, item: SourceItem) -> tuple[str, ...]:
    """All existing files of an item; reading reports the faults."""
    files = {item.file, *([item.texture] if item.texture else []), *item.files}
    for name in tuple(files):
        if name.lower().endswith(".obj"):
            try:
                files |= {*find_obj_material_files(folder, name)}
            except RefusedError:
                continue
        elif name.lower().endswith(".gltf"):
            files |= set(find_gltf_files(folder, name))
    return tuple(sorted(files))


_LETTERS: Final = dict(
    zip(
        "абвгдеёжзийклмнопрстуфхцчшщъыьэюяіїєґαβγδεζηθικλμνξοπρσςτυφχψωß",
        "a b v g d e e zh z i y k l m n o p r s t u f kh ts ch sh shch - y - e yu ya i yi ye g "
        "a v g d e z i th i k l m n x o p r s s t y f ch ps o ss".replace("-", "").split(" "),
        strict=True,
    )
)
"""Cyrillic and Greek letters, whose Unicode names are not their usual transliteration, and the sharp s."""
_LETTER_NAME: Final = re.compile(r"(?:LETTER|SYLLABLE|LIGATURE|VOWEL SIGN|DIGIT)(?: SMALL)? (.+?)(?: WITH .+)?$")


def slugify_name(name: str) -> str:
    """A name as files and programs can bear it: letters, digits, ``_`` and ``-``, at most 64.

    Other scripts are transliterated, by the Unicode names of letters that are their sounds; ideographs become their
    code points.
    """
    plain = "".join(map(_transliterate, unicodedata.normalize("NFKC", name)))
    slug = re.sub(r"[^A-Za-z0-9_-]+", "_", plain).strip("_-")[:64]
    return slug if re.match(r"[A-Za-z0-9]", slug) else f"asset_{slug}".rstrip("_")


def _transliterate(letter: str) -> str:
    if letter.isascii():
        return letter
    base = unicodedata.normalize("NFKD", letter)[0]
    latin = _LETTERS.get(letter.lower(), _LETTERS.get(base.lower()))
    if latin is None and (match := _LETTER_NAME.search(unicodedata.name(letter, ""))):
        latin = match[1].replace(" ", "").lower()
    if latin is None:
        kind = unicodedata.category(letter)
        latin = "" if kind in ("Lm", "Mn") else f"_u{ord(letter):x}" if kind[0] in "LN" else "_"
    return latin.capitalize() if letter.isupper() else latin


def _belongs_to_claimed_item(file: str, claimed: set[str]) -> bool:
    return file in claimed or any(f"{parent}/" in claimed for parent in PurePosixPath(file).parents)


def _lower_suffix(file: str) -> str:
    return PurePosixPath(file).suffix.lower()


def _find_hope_items(names: list[str]) -> Iterator[SourceItem]:
    """The HOPE meshes as LIBERO packages them, ``stable_hope_objects/KIND``, without their recoloured copies."""
    homes: dict[str, list[str]] = {}
    for name in names:
        parts = PurePosixPath(name).parts
        if _HOPE in parts[:-2]:
            homes.setdefault("/".join(parts[: parts.index(_HOPE) + 2]), []).append(name)
    kinds = {PurePosixPath(home).name for home in homes}
    for home, files in homes.items():
        kind = PurePosixPath(home).name
        direct = (file for file in files if PurePosixPath(file).parent.as_posix() == home and file.endswith(".obj"))
        visible = (file for file in direct if not _COLLISION.search(PurePosixPath(file).stem))
        mesh = next(visible, None) or next((file for file in files if file.endswith(".msh")), None)
        if mesh is not None and kind.partition("_")[2] not in kinds:
            texture = next((file for file in files if file.endswith("/texture_map.png")), None)
            yield SourceItem(kind="hope", name=kind, file=mesh, texture=texture, license=HOPE_LICENSE)


def _find_gso_items(names: list[str]) -> Iterator[SourceItem]:
    """Google Scanned Objects: ``NAME/meshes/model.obj`` with its picture in another folder."""
    known = set(names)
    for name in names:
        if name.endswith("meshes/model.obj"):
            home = name.removesuffix("meshes/model.obj")
            picture, metadata = f"{home}materials/textures/texture.png", f"{home}metadata.pbtxt"
            files, texture = (metadata,) if metadata in known else (), picture if picture in known else None
            label = PurePosixPath(home).name or "model"
            yield SourceItem(kind="gso", name=label, file=name, files=files, texture=texture, license=OPEN_LICENSE)


def _find_ycb_items(names: list[str]) -> Iterator[SourceItem]:
    """YCB objects: a folder ``NNN_name`` with several meshes of the same object."""
    known = set(names)
    parents = {parent for name in names for parent in PurePosixPath(name).parents}
    for home in sorted(parent.as_posix() for parent in parents if _YCB.match(parent.name)):
        file = next((f"{home}/{file}" for file in _YCB_FILES if f"{home}/{file}" in known), None)
        if file is not None:
            yield SourceItem(kind="ycb", name=PurePosixPath(home).name, file=file, license=OPEN_LICENSE)


def _find_urdf_and_mjcf_items(
    folder: SourceFolder, names: list[str], claimed: set[str], beside: dict[str, str]
) -> Iterator[SourceItem]:
    """URDF, SDF and MJCF files with the meshes that they name; a sole description of a folder owns all meshes
    ``beside`` it."""
    known = set(names)
    titles = {
        name: title
        for name in names
        if PurePosixPath(name).name == _CONFIG
        for name, title in _read_config(folder, name, known)
    }
    configured = {PurePosixPath(name).parent.as_posix() for name in titles}
    descriptions = [
        name
        for name in names
        if _lower_suffix(name) in DESCRIPTIONS
        and (_lower_suffix(name) != ".sdf" or name in titles or PurePosixPath(name).parent.as_posix() not in configured)
    ]
    homes = Counter(PurePosixPath(name).parent.as_posix() for name in descriptions)
    # A source has up to 100,000 descriptions, and none may look through all files.
    described, ordered, looked_at = set(descriptions), sorted(names), 0
    namesakes: dict[str, list[int]] = {}
    for number, name in enumerate(names):
        namesakes.setdefault(PurePosixPath(name).name.casefold(), []).append(number)
    for name in descriptions:
        if _belongs_to_claimed_item(name, claimed):
            continue
        mark = {".urdf": "", ".sdf": "<sdf"}.get(_lower_suffix(name), "<mujoco")
        with (folder.root / name).open(encoding="utf-8", errors="replace") as opened:
            text = opened.read(_HEAD)
            if mark not in text:
                continue  # XML of another kind
            text += opened.read(_MOST)
        mentions = (file or uri.strip() for file, uri in _FILES.findall(text))
        mentioned = {PurePosixPath(unquote(file).replace("\\", "/")).name.casefold() for file in mentions}
        looked_at += sum(len(namesakes.get(word, ())) for word in mentioned)
        if looked_at > _MOST_NAMESAKES:
            message = f"the descriptions in {folder.root.name} name files of which there are too many of the same name"
            raise InputError(f"{message} (over {_MOST_NAMESAKES} pairs)", "import it in parts")
        vicinity = PurePosixPath(name).parent.parent.as_posix()  # of "." it is "." itself
        numbers = sorted(number for word in mentioned for number in namesakes.get(word, ()))
        around = "" if vicinity == "." else f"{vicinity}/"
        parts = tuple(names[number] for number in numbers if names[number].startswith(around))
        claimed |= set(parts)
        pure = PurePosixPath(name)
        home = pure.parent.as_posix()
        if home != "." and homes[home] == 1:
            first, end = (bisect_left(ordered, f"{home}{letter}") for letter in "/0")  # 0 comes after the slash
            inside = set(ordered[first:end]) - described
            beside |= dict.fromkeys(inside - claimed, name)
            claimed |= inside
        called = titles.get(name) or _name_that_tells(pure)
        yield SourceItem(kind=DESCRIPTIONS[_lower_suffix(name)], name=called, file=name, files=parts)


def _read_config(folder: SourceFolder, config: str, known: set[str]) -> Iterator[tuple[str, str]]:
    """The newest SDF file of ``known`` files that a ``model.config`` of Gazebo names, and the name of the model."""
    with (folder.root / config).open(encoding="utf-8", errors="replace") as file:
        text = file.read(_MOST)
    versions = [
        ([int(part) for part in version.split(".") if part], name.strip())
        for version, name in _CONFIGURED.findall(text)
    ]
    title = re.search(r"<name>([^<]*)</name>", text)
    file = (PurePosixPath(config).parent / max(versions)[1]).as_posix() if versions else ""
    if file in known:
        yield file, title[1].strip() if title is not None else ""


def _name_that_tells(file: PurePosixPath) -> str:
    """The name of a file without its suffix, or that of its folder for a meaningless name."""
    return file.parent.name if file.stem.lower() in _UNTOLD and file.parent.name else file.stem
