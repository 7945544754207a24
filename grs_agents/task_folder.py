"""A folder that holds a task as data: a run, or the instances that ``grs instances`` made of one.

Both have ``instances/seed_<N>.json`` and, for assets of their own, ``assets/``, for an arm of their own ``robot/``. No
generated code is in either's way.
"""

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from grs_agents.errors import InputError, UnknownNameError
from grs_agents.foreign import check_run_folder, read_bytes, read_json
from grs_agents.library import Library
from grs_agents.sim import TaskInstance, parse_instance_json
from grs_agents.sim.arms import ROBOT_FOLDER
from grs_agents.sim.instance import resolve_robot_path

_REMEDY = "name a folder that `grs run` or `grs instances` wrote"
_ASSETS = "assets"
_INSTANCE_FILE = re.compile(r"seed_(\d{1,10})\.json")


@dataclass(frozen=True)
class TaskFolder:
    """Task instances by seed, with the library that has their assets."""

    path: Path
    library: Library
    files: Mapping[int, Path]  # the JSON file of each seed's instance

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds that have an instance, ascending."""
        return tuple(self.files)

    def read_instance(self, seed: int) -> TaskInstance:
        """The instance of a seed; raises ``UnknownNameError`` for another seed, ``InputError`` for a faulty file."""
        if seed not in self.files:
            raise UnknownNameError("seed", str(seed), tuple(map(str, self.seeds)))
        return resolve_robot_path(parse_instance_json(read_bytes(self.files[seed], _REMEDY)), self.path)

    def copy_assets_and_robot(self, out: Path) -> None:
        """Copy what instances name of the folder itself into another one: assets, and the files of an arm."""
        for name in (_ASSETS, ROBOT_FOLDER):
            if (self.path / name).is_dir():
                shutil.copytree(self.path / name, out / name)


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
    found = {int(match[1]): file for file in files if (match := _INSTANCE_FILE.fullmatch(file.name))}
    if not found:
        raise InputError(f"{path} holds no task instances", _REMEDY)
    library, own = Library(), path / _ASSETS
    return TaskFolder(
        path, library.copy_with_overlay_root(own) if own.is_dir() else library, dict(sorted(found.items()))
    )
