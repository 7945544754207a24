"""Files of an RGB-D picture in a folder, recognised by usual names, then by content."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from PIL import Image as Pillow

from grs_agents.base.errors import InputError, suggest_name
from grs_agents.base.foreign.files import is_folder, list_folder_names
from grs_agents.base.foreign.pictures import FORMATS, MALFORMED
from grs_agents.perception.reading import calibration_files, point_cloud
from grs_agents.perception.reading.picture import COLOR_SUFFIXES, DEPTH_SUFFIXES, GREY

COLORS = (
    ("rgb", "color", "colour", "rgba", "bgr"),
    ("image", "images", "img", "photo", "picture", "frame", "view", "im"),
)
"""Words in the names of photos, those that mean nothing else first."""
DEPTHS = (("depth", "depths", "depthmap", "dpt"), ("disparity", "disp", "range", "distance", "z", "d"))
CAMERAS = (
    *("camera", "cam", "intrinsic", "intrinsics", "intr", "calib", "calibration", "info", "k", "params", "parameters"),
    *("meta", "metadata", "config", "settings", "pinhole", "realsense", "kinect", "primesense"),
)
DERIVED = (
    *(
        "mask",
        "masks",
        "label",
        "labels",
        "seg",
        "segmentation",
        "instance",
        "instances",
        "semantic",
        "normal",
        "normals",
    ),
    *("ir", "infrared", "infra", "conf", "confidence", "vis", "viz", "overlay", "annotated", "colormap", "colored"),
    *("colorized", "colorised", "colourised", "preview", "thumb", "thumbnail", "heatmap", "pred", "prediction", "bbox"),
    *("outline", "boundary", "nocs", "coord", "render", "rendered", "mirrored", "background", "result", "results"),
)
"""Words in the names of pictures that are neither the photo nor its depth."""
_ROLES = frozenset(word for words in (*COLORS, *DEPTHS, CAMERAS) for word in words)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+(?:\.\d+)?")
_NEAREST_STAMP = 0.04  # seconds between colour and depth of a picture: a frame of a camera at 25 Hz
MOST_FILES = 20_000
"""Files of a folder that are looked at; a recording of ten minutes at 30 Hz has more, of which a picture is meant."""


@dataclass(frozen=True)
class SceneFiles:
    """Files of one RGB-D picture, by paths relative to the folder."""

    photo: PurePath
    depth: PurePath | None
    cameras: tuple[tuple[PurePath, ...], ...]  # groups of files that may hold intrinsics, the likeliest first
    key: str  # words that its files' names share with no other picture's

    @property
    def has_standard_names(self) -> bool:
        """Whether the names are the documented ones, which need no note."""
        names = (self.photo, self.depth) if self.depth is not None else (self.photo,)
        return all(len(name.parts) == 1 and name.stem.lower() in ("rgb", "color", "depth") for name in names)


@dataclass(frozen=True)
class _Named:
    """A file with the words of its name that say neither its role nor its format."""

    path: PurePath
    key: str


def find_scene_files(folder: Path, choice: str = "") -> SceneFiles | None:
    """The photo in a folder, or in usual subfolders, with its depth and the files of its camera.

    Args:
        folder: its pictures may lie in subfolders such as ``rgb/`` and ``depth/``.
        choice: key, file name or number from 0 of the picture, if the folder holds several.

    Returns:
        The files, or ``None`` if the folder holds no photo.

    Raises:
        InputError: the folder cannot be read, holds several pictures and ``choice`` names none of them, or several
            files could be the depth.
    """
    paths = list_files(folder)
    photos = _pick_by_words(paths, COLORS, COLOR_SUFFIXES)
    clouds = [path for path in paths if is_point_cloud_name(path.name) and len(path.parts) == 1]
    depths = _pick_by_words(paths, DEPTHS, DEPTH_SUFFIXES)
    if not photos or not depths:
        rest = [path for path in paths if not _words(path) & {*_ROLES, *DERIVED} and len(path.parts) == 1]
        if not photos:
            photos = [_Named(path, _key(path)) for path in rest if _holds_colors(folder / path)]
        if not depths and not clouds:
            depths = [_Named(path, _key(path)) for path in rest if _holds_depth(folder / path)]
    if not photos:
        return None
    if choice and any(choice in (path.name, str(path)) for path in (depth.path for depth in depths)):
        depths = [depth for depth in depths if choice in (depth.path.name, str(depth.path))]
        choice = ""
    pairs = _pair(photos, depths)
    if not pairs:
        if len(photos) == 1 and len(depths) > 1:
            raise _ambiguous(folder, [str(depth.path) for depth in depths], "the depth")
        pairs = [(photo, depths[0] if len(depths) == len(photos) == 1 else None) for photo in photos]
    photo, depth = _choose(folder, pairs, choice)
    if depth is None and clouds:
        if len(clouds) > 1:
            raise _ambiguous(folder, [str(cloud) for cloud in clouds], "the depth")
        depth = _Named(clouds[0], "")
    keys = {each.key for each, _ in pairs}
    return SceneFiles(
        photo.path, None if depth is None else depth.path, _list_cameras(paths, photo.key, keys), photo.key
    )


def find_files_beside_photo(photo: Path) -> SceneFiles | None:
    """The files of a photo, if the names in its folder pair it with a depth picture; ``None`` if they do not.

    All colour pictures there count as photos, whatever their names.
    """
    try:
        paths = list_files(photo.parent)
    except InputError:  # the photo can be read alone
        return None
    photos = [
        _Named(path, _key(path))
        for path in paths
        if path.suffix.lower() in COLOR_SUFFIXES and not _words(path) & {*DERIVED, *DEPTHS[0]} and len(path.parts) == 1
    ]
    depths = [depth for depth in _pick_by_words(paths, DEPTHS, DEPTH_SUFFIXES) if depth.path.name != photo.name]
    taken = {depth.path for depth in depths}
    pairs = _pair([each for each in photos if each.path not in taken], depths)
    keys = {each.key for each, _ in pairs}
    for each, depth in pairs:
        if each.path.name == photo.name and depth is not None:
            return SceneFiles(each.path, depth.path, _list_cameras(paths, each.key, keys), each.key)
    return None


def is_point_cloud_name(name: str) -> bool:
    """Whether the reader takes a file of this name as the points of a scene."""
    path = Path(name.lower())
    return path.suffix in point_cloud.SUFFIXES and not _words(path) & {*DERIVED, *DEPTHS[0], *CAMERAS}


def has_usual_name(path: PurePath) -> bool:
    """Whether the name says that the file is the photo, its depth, its points or its camera."""
    return bool(_words(path) & _ROLES) or is_point_cloud_name(path.name)


def is_camera_name(path: PurePath) -> bool:
    """Whether the name says that the file describes a camera."""
    return bool(_words(path) & set(CAMERAS))


def list_files(folder: Path) -> list[PurePath]:
    """Files of the folder and of its subfolders with usual names, relative to it."""
    names = list_folder_names(folder)
    paths = [PurePath(name) for name in names if not name.startswith(".")]
    subfolders = [path for path in paths if _words(path) & _ROLES and not path.suffix and is_folder(folder / path)]
    for subfolder in subfolders:
        if not _words(subfolder) & set(DERIVED):
            paths += [subfolder / name for name in list_folder_names(folder / subfolder) if not name.startswith(".")]
    if len(paths) > MOST_FILES:
        raise InputError(f"{folder} holds {len(paths)} files, more than {MOST_FILES}", "copy the files of one picture")
    return paths


def _words(path: PurePath) -> set[str]:
    return {word.lower() for part in (*path.parts[:-1], path.stem) for word in _WORD.findall(part)}


def _key(path: PurePath) -> str:
    """Words of the name that say neither role nor format; numbers without leading zeros."""
    words = [word.lower() for word in _WORD.findall(path.stem)]
    kept = [word for word in words if word not in _ROLES]
    return "-".join(word.lstrip("0") or "0" if word.isdigit() else word for word in kept)


def _pick_by_words(
    paths: Sequence[PurePath], words: tuple[tuple[str, ...], tuple[str, ...]], suffixes: tuple[str, ...]
) -> list[_Named]:
    """Files with a word of the first group in their names or subfolder, else of the second."""
    excluded = {*DERIVED, *(() if words is DEPTHS else DEPTHS[0])}
    candidates = [path for path in paths if path.suffix.lower() in suffixes and not _words(path) & excluded]
    for group in words:
        picked = [_Named(path, _key(path)) for path in candidates if _words(path) & set(group)]
        top = [named for named in picked if len(named.path.parts) == 1]
        if picked:
            return top or picked
    return []


def _pair(photos: Sequence[_Named], depths: Sequence[_Named]) -> list[tuple[_Named, _Named | None]]:
    """Photos and depths of equal keys; or of the nearest time stamps."""
    by_key: dict[str, list[_Named]] = {}
    for depth in depths:
        by_key.setdefault(depth.key, []).append(depth)
    pairs: list[tuple[_Named, _Named | None]] = [
        (photo, by_key[photo.key][0]) for photo in photos if len(by_key.get(photo.key, [])) == 1
    ]
    stamped = sorted((float(depth.key), depth) for depth in depths if re.fullmatch(r"\d+\.\d+", depth.key))
    if not pairs and stamped and all(re.fullmatch(r"\d+\.\d+", photo.key) for photo in photos):
        for photo in photos:
            stamp, depth = min(stamped, key=lambda item: abs(item[0] - float(photo.key)))
            if abs(stamp - float(photo.key)) <= _NEAREST_STAMP:
                pairs.append((photo, depth))
    if not pairs and len(photos) == len(depths) == 1:
        pairs = [(photos[0], depths[0])]
    return pairs


def _choose(folder: Path, pairs: Sequence[tuple[_Named, _Named | None]], choice: str) -> tuple[_Named, _Named | None]:
    if choice:
        plain = choice.lstrip("0") or "0" if choice.isdigit() else choice.lower()
        chosen = [pair for pair in pairs if choice in (pair[0].path.name, str(pair[0].path)) or plain == pair[0].key]
        if not chosen and choice.isdigit() and int(choice) < len(pairs):
            chosen = [pairs[int(choice)]]
        if not chosen:
            chosen = [pair for pair in pairs if plain in pair[0].key.split("-")]
        if len(chosen) == 1:
            return chosen[0]
        names = [pair[0].key or pair[0].path.name for pair in pairs]
        found = f"{folder} holds {'no' if not chosen else 'several'} pictures named {choice[:60]!a}"
        raise InputError(found, f"{suggest_name(choice, names)}name one of {_shorten(names)}")
    if len(pairs) == 1:
        return pairs[0]
    standard = [pair for pair in pairs if pair[0].path.stem.lower() in ("rgb", "color")]
    if len(standard) == 1:
        return standard[0]
    if len({photo.key for photo, _ in pairs}) < len(pairs):
        raise _ambiguous(folder, [str(photo.path) for photo, _ in pairs], "the photo")
    keys = [photo.key or photo.path.name for photo, _ in pairs]
    remedy = f"name one as {folder}:{keys[0]} (of {_shorten(keys)}), or by number from 0 to {len(keys) - 1}"
    raise InputError(f"{folder} holds {len(pairs)} pictures", remedy)


def _ambiguous(folder: Path, names: Sequence[str], role: str) -> InputError:
    found = f"{folder} holds {' and '.join(names[:4])}: which of them is {role} cannot be told"
    return InputError(found, f"name one as {folder}:{names[0]}, or leave one of them")


def _shorten(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])}, ... {names[-1]}"


def _holds_colors(file: Path) -> bool:
    return file.suffix.lower() in COLOR_SUFFIXES and _picture_mode(file) not in (None, "I", "F", *GREY)


def _holds_depth(file: Path) -> bool:
    suffix = file.suffix.lower()
    return suffix in (".exr", ".npy", ".npz", ".pgm") or (
        suffix in DEPTH_SUFFIXES and (_picture_mode(file) or "").startswith(("I", "F"))
    )


def _picture_mode(file: Path) -> str | None:
    """Pillow's mode of a picture, from its header; ``None`` for another file."""
    if not file.is_file():
        return None
    try:
        with Pillow.open(file, formats=(*FORMATS, "PPM")) as image:
            return image.mode
    except MALFORMED:  # reported when it is read
        return None


def _list_cameras(paths: Iterable[PurePath], key: str, keys: set[str]) -> tuple[tuple[PurePath, ...], ...]:
    """Groups of files that may hold the camera of the picture ``key``, the likeliest first; those of other pictures in
    ``keys`` are left out."""
    ranked: dict[int, list[PurePath]] = {}
    for path in paths:
        words, suffix, mine = _words(path), path.suffix.lower(), _key(path)
        if str(path) == "camera.json":
            return ((path,),)
        if (mine in keys and mine != key) or (suffix not in calibration_files.SUFFIXES and suffix != ".npy"):
            continue
        named = is_camera_name(path)
        if suffix == ".npy" and not named:
            continue
        rank = 0 if named and words & {*COLORS[0]} else 1 if named and not words & set(DEPTHS[0]) else 2 if named else 3
        ranked.setdefault(rank - (mine == key and bool(key)), []).append(path)
    return tuple(tuple(sorted(ranked[rank])) for rank in sorted(ranked))
