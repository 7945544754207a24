"""The scenes that a command line names: one by one, by folder, by BOP data set, by glob."""

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
    """Every scene that ``names`` tell of, as `grs run` takes it, each once, in their order.

    A name is a scene, a sample scene, a folder of scene folders and ``.npz`` files, ``bop:`` with a data set's split,
    scene or image, or a glob of any of these.

    Raises:
        InputError: a name tells of no scene.
    """
    found: dict[str, None] = {}
    for name in names:
        scenes = [scene for part in _expand_glob(name) for scene in _list_scenes_at_path(part)]
        if not scenes:
            raise InputError(f"{name} names no scene", _REMEDY)
        found.update(dict.fromkeys(scenes))
    return tuple(found)


def _expand_glob(name: str) -> list[str]:
    prefix, pattern = (_PREFIX, name[len(_PREFIX) :]) if name.startswith(_PREFIX) else ("", name)
    if not set(pattern) & set(_WILD):
        return [name]
    path = Path(pattern)
    return [prefix + str(found) for found in sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))]


def _list_scenes_at_path(name: str) -> Iterator[str]:
    path = resolve_scene_path(Path(name))
    if is_bop_source(path):
        yield from _list_scenes_of_bop_data_set(Path(name[len(_PREFIX) :]))
    elif is_folder(path) and not _holds_photo(path):
        inside = sorted(path.iterdir())
        yield from (str(item.resolve()) for item in inside if _is_scene_file_or_folder(item))
    else:
        check_scene_source(path)
        yield str(path.resolve())


def _holds_photo(folder: Path) -> bool:
    return (folder / "camera.json").exists() or any(file.stem in ("rgb", "color") for file in folder.iterdir())


def _is_scene_file_or_folder(item: Path) -> bool:
    return item.suffix.lower() == ".npz" if item.is_file() else is_folder(item) and _holds_photo(item)


def _list_scenes_of_bop_data_set(path: Path) -> Iterator[str]:
    """The images of a split or of a scene folder; an image alone is itself."""
    for cameras in sorted([*path.glob(_CAMERAS), *path.glob(f"*/{_CAMERAS}")]):
        try:
            numbers = sorted(map(int, read_json(cameras, "see github.com/thodan/bop_toolkit")))
        except (ValueError, TypeError) as error:
            raise InputError(f"cannot read {cameras}: {error}", "see github.com/thodan/bop_toolkit") from error
        yield from (f"{_PREFIX}{cameras.parent.resolve() / str(number)}" for number in numbers)
    if not is_folder(path):
        check_scene_source(Path(f"{_PREFIX}{path}"))
        yield f"{_PREFIX}{path.resolve()}"
