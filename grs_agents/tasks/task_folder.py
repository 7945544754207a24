"""Task folders: a run, or the varied instances of ``grs instances``.

Both have ``instances/seed_<N>.json``, and ``assets/`` and ``robot/`` if they bring assets or an arm. No generated code
is needed to use them.
"""

import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.files import copy_folder
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.library.library import Library
from grs_agents.sim.arms.arm_files import ROBOT_FOLDER, resolve_robot_path
from grs_agents.sim.instance.task_instance import TaskInstance, parse_instance_json

_REMEDY = "name a folder that `grs run` or `grs instances` wrote"
_ASSETS = "assets"
DATASET_FILE = "grs.json"
"""File with the card of a data set, in its folder."""
_DEPTH = 4
"""Most levels from a file of a data set up to its folder: Minari's lie deepest."""
_INSTANCE_FILE = re.compile(r"seed_(\d{1,10})\.json")


@dataclass(frozen=True)
class TaskFolder:
    """Task instances by seed, with the library of their assets."""

    path: Path
    library: Library
    files: Mapping[int, Path]  # the JSON file of each seed's instance

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the instances, ascending."""
        return tuple(self.files)

    def read_instance(self, seed: int) -> TaskInstance:
        """The instance of a seed; raises ``UnknownNameError`` for another seed, ``InputError`` for a faulty file."""
        if seed not in self.files:
            raise UnknownNameError("seed", str(seed), tuple(map(str, self.seeds)))
        return resolve_robot_path(parse_instance_json(read_bytes(self.files[seed], _REMEDY)), self.path)

    def copy_assets_and_robot(self, out: Path) -> None:
        """Copy the folder's own assets and arm into another folder."""
        for name in (_ASSETS, ROBOT_FOLDER):
            if (self.path / name).is_dir():
                copy_folder(self.path / name, out / name)


def open_task_folder(path: Path, accepted: bool = True) -> TaskFolder:
    """Open a folder of task instances.

    Args:
        path: the folder.
        accepted: refuse a run that was not accepted, since nothing shows that its instances can be solved.

    Raises:
        InputError: the folder holds no instances, something in it is no regular file or leads out of it, or its run was
            not accepted.
    """
    if not path.is_dir():
        raise InputError(f"{path} is no folder", _REMEDY)
    check_run_folder(path)
    record = path / "run.json"
    status = read_json(record, _REMEDY).get("status") if record.is_file() else "accepted"
    if accepted and status != "accepted":
        raise InputError(f"the run {path} is {status}, not accepted", "name an accepted run; `grs show` tells why not")
    files = (path / "instances").glob("seed_*.json")
    instances = {int(match[1]): file for file in files if (match := _INSTANCE_FILE.fullmatch(file.name))}
    if not instances:
        raise InputError(f"{path} holds no task instances", _REMEDY)
    library, assets = Library(), path / _ASSETS
    return TaskFolder(
        path, library.copy_with_overlay_root(assets) if assets.is_dir() else library, dict(sorted(instances.items()))
    )


def find_dataset_folder(folder: Path, identity: str) -> Path:
    """The folder of the data set ``identity``: ``folder``, or its present folder if the data set was moved.

    A file of a data set does not know its path. Candidates are the folders above files named on the command line, that
    of ``MINARI_DATASETS_PATH``, and the current folder.

    Raises:
        InputError: no candidate is the data set.
    """
    if folder.is_dir() and not (folder / DATASET_FILE).exists():  # the user names another task folder
        return folder
    named = [Path(part) for argument in sys.argv[1:] for part in (argument, argument.partition("=")[2]) if part]
    named += [Path(os.environ[name]) for name in ("MINARI_DATASETS_PATH",) if os.environ.get(name)]
    near: list[Path] = []
    for path in named:
        try:
            if path.exists():
                near += [path.resolve(), *path.resolve().parents[:_DEPTH]]
        except (OSError, ValueError):  # an argument that is no path
            continue
    for candidate in (folder, *near, Path.cwd()):
        if _read_dataset_identity(candidate) == identity:
            return candidate
    raise InputError(
        f"the data set of this environment is not in {folder}, where it was made",
        "give its present folder: run=FOLDER, or name a file of it on the command line",
    )


def _read_dataset_identity(folder: Path) -> str:
    """Id of the data set in a folder; empty without a data set."""
    file = folder / DATASET_FILE
    if not file.is_file():
        return ""
    try:
        card = read_json(file, _REMEDY).get("dataset")
    except InputError:  # another program's file of that name
        return ""
    return str(cast("dict[str, object]", card).get("id")) if isinstance(card, dict) else ""
