"""A scene that was comprehended before: the folder of a run, whose pictures and proxies another run takes over."""

from pathlib import Path
from typing import Any, Final

from grs_agents.base.errors import InputError
from grs_agents.base.files import copy_folder
from grs_agents.base.foreign.files import is_folder, path_exists, read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.types import SceneDescription, read_scene_description

_OF_SCENE: Final = ("scene", "assets")
"""The folders of a run that its scene is made of: pictures, and proxies with the background."""
_REMEDY: Final = "name the photo instead"


def is_known_scene(source: Path) -> bool:
    """Whether ``source`` is the folder of a run, or of ``grs scene``, that got as far as a scene."""
    if is_bop_source(source) or not is_folder(source):
        return False
    return path_exists(source / "run.json") and path_exists(source / "scene.json")


def copy_scene_from_run(source: Path, folder: Path, robot: str) -> SceneDescription:
    """Copy what the scene of another run is made of into the run folder ``folder``.

    Raises:
        InputError: the folder is no plain run folder, cannot be read, or its scene was made for another ``robot``.
    """
    check_run_folder(source)
    made_for = _robot_name_from_run_record(read_json(source / "run.json", _REMEDY))
    if made_for != robot:
        raise InputError(f"the scene of {source} was made for robot={made_for}, not {robot}", _REMEDY)
    scene = read_scene_description(source / "scene.json")
    for name in _OF_SCENE:
        if path_exists(source / name):
            copy_folder(source / name, folder / name)
    scene.write(folder / "scene.json")
    return scene


def _robot_name_from_run_record(record: Any) -> str:
    """The robot that the configuration of a run names; empty where the record tells none."""
    try:
        return str(record["config"]["robot"])
    except (KeyError, TypeError):
        return ""
