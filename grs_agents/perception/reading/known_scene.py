"""Known scenes: the folder of an earlier run, whose pictures and proxies another run reuses."""

from pathlib import Path
from typing import Any, Final

from grs_agents.base.errors import InputError
from grs_agents.base.files import copy_folder
from grs_agents.base.foreign.files import is_folder, path_exists, read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.perception.edits import FILE as EDITS
from grs_agents.perception.edits import read_edits, write_edits
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.types import SceneDescription, read_scene_description
from grs_agents.sim.hands.hand import DEFAULT_HAND

_OF_SCENE: Final = ("scene", "assets")
"""Folders of a run's scene: pictures, and proxies with the background."""
_REMEDY: Final = "name the photo instead"


def is_known_scene(source: Path) -> bool:
    """Whether ``source`` is the folder of a run, or of ``grs scene``, that got as far as a scene."""
    if is_bop_source(source) or not is_folder(source):
        return False
    return path_exists(source / "run.json") and path_exists(source / "scene.json")


def copy_scene_from_run(source: Path, folder: Path, robot: str, hand: str) -> SceneDescription:
    """Copy the scene of another run, with its pictures and proxies, into the run folder ``folder``.

    Raises:
        InputError: the folder is no plain run folder, cannot be read, or its scene was made for another ``robot`` or
            ``hand``.
    """
    check_run_folder(source)
    record: Any = read_json(source / "run.json", _REMEDY)
    try:
        made_for, held_by = str(record["config"]["robot"]), str(record["config"].get("hand", DEFAULT_HAND))
    except (AttributeError, KeyError, TypeError):
        made_for = held_by = ""
    for key, found, wanted in (("robot", made_for, robot), ("hand", held_by, hand)):
        if found != wanted:
            raise InputError(f"the scene of {source} was made for {key}={found}, not {wanted}", _REMEDY)
    scene = read_scene_description(source / "scene.json")
    for name in _OF_SCENE:
        if path_exists(source / name):
            copy_folder(source / name, folder / name)
    scene.write(folder / "scene.json")
    if path_exists(source / EDITS):
        write_edits(read_edits(source / EDITS), folder / EDITS)
    return scene
