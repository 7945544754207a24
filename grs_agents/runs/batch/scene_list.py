"""Scenes named on a command line: single scenes, folders, BOP data sets, globs."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import is_folder, read_json
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.reading.scene_source import check_scene_source, resolve_scene_path

_PREFIX = "bop:"
_CAMERAS = "scene_camera.json"
_WILD = "*?["
_REMEDY = "name scenes, folders of scenes, bop:ROOT/SPLIT, .npz files, or a glob in quotes"


def list_scenes(names: Sequence[str]) -> tuple[str, ...]:
    """The scenes of ``names``, in order and without duplicates, as accepted by `grs run`.

    A name is a scene, a sample scene, a folder of scene folders and ``.npz`` files, ``bop:`` with a data set's
    split, scene or image, or a glob of any of these.

    Raises:
        InputError: a name has no scene.
    """
    unique: dict[str, None] = {}
    for name in names:
        prefix, pattern = (_PREFIX, name[len(_PREFIX) :]) if name.startswith(_PREFIX) else ("", name)
        matches = [name]
        if set(pattern) & set(_WILD):
            path = Path(pattern)
            paths = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
            matches = [f"{prefix}{path}" for path in paths]
        scenes = [scene for match in matches for scene in _list_scenes_at_path(match)]
        if not scenes:
            raise InputError(f"{name} names no scene", _REMEDY)
        unique.update(dict.fromkeys(scenes))
    return tuple(unique)


def _list_scenes_at_path(name: str) -> Iterator[str]:
    path = resolve_scene_path(Path(name))
    if is_bop_source(path):
        yield from _list_scenes_of_bop_data_set(Path(name[len(_PREFIX) :]))
    elif is_folder(path) and not _holds_photo(path):
        for item in sorted(path.iterdir()):
            if item.suffix.lower() == ".npz" if item.is_file() else is_folder(item) and _holds_photo(item):
                yield str(item.resolve())
    else:
        check_scene_source(path)
        yield str(path.resolve())


def _holds_photo(folder: Path) -> bool:
    return (folder / "camera.json").exists() or any(file.stem in ("rgb", "color") for file in folder.iterdir())


def _list_scenes_of_bop_data_set(path: Path) -> Iterator[str]:
    """The images of a split or of a scene folder, or a single image."""
    for cameras in sorted([*path.glob(_CAMERAS), *path.glob(f"*/{_CAMERAS}")]):
        try:
            numbers = sorted(map(int, read_json(cameras, "see github.com/thodan/bop_toolkit")))
        except (ValueError, TypeError) as error:
            raise InputError(f"cannot read {cameras}: {error}", "see github.com/thodan/bop_toolkit") from error
        yield from (f"{_PREFIX}{cameras.parent.resolve() / str(number)}" for number in numbers)
    if not is_folder(path):
        check_scene_source(Path(f"{_PREFIX}{path}"))
        yield f"{_PREFIX}{path.resolve()}"
