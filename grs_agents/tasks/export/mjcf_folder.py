"""Export of a scene as a self-contained folder that opens in plain MuJoCo."""

import hashlib
import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from grs_agents.base.errors import InputError
from grs_agents.base.files import unwritable_error, write_bytes, write_text
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import hash_instance
from grs_agents.tasks.export.mjcf_scene import MjcfScene, build_mjcf_scene
from grs_agents.tasks.export.readme import Words, write_readme_text
from grs_agents.tasks.task_folder import TaskFolder

SCENE, README, INSTANCE, ASSETS = "scene.xml", "README.md", "instance.json", "assets"
_MARK: Final = "grs_instance"
"""Name of the model's text that marks an export and holds the hash of its instance."""
_REMEDY: Final = "name a new or empty folder with --out, or remove it"
_MOST: Final = 1 << 26
"""Most bytes read of an earlier export's XML."""


@dataclass(frozen=True)
class MjcfFolder:
    """Summary of an export."""

    folder: Path
    seed: int
    portable: bool
    warp: bool
    instance_hash: str
    files: int
    size: int  # of all files, bytes

    @property
    def scene(self) -> Path:
        """The MJCF file."""
        return self.folder / SCENE


def export_mjcf(
    task: TaskFolder, out: Path, seed: int | None = None, portable: bool = False, warp: bool = False
) -> MjcfFolder:
    """Write the scene of a task instance to a folder of its own.

    Args:
        task: folder of the instance.
        out: a new or empty folder, or an earlier export, which is replaced.
        seed: of the instance, None for the first.
        portable: for MuJoCo 3.3 and dm_control too, see `build_mjcf_scene`.
        warp: for MuJoCo Warp too.

    Raises:
        UnknownNameError: there is no instance of that seed.
        InputError: ``out`` holds something else, a file of the instance cannot be read, or the folder not be written.
        SimulationError: the scene cannot be set up.
    """
    _check_output_folder(out)
    instance = task.read_instance(task.seeds[0] if seed is None else seed)
    scene = build_mjcf_scene(instance, task.library, portable, warp)
    scene.spec.add_text(name=_MARK, data=hash_instance(instance))
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as temporary:
            draft = Path(temporary) / "made"
            _write_folder(draft, scene, task)
            files = [file for file in draft.rglob("*") if file.is_file()]
            size = sum(file.stat().st_size for file in files)
            _check_output_folder(out)
            if out.exists():
                shutil.rmtree(out)
            draft.rename(out)
    except OSError as error:
        raise unwritable_error(out, error) from error
    return MjcfFolder(out, instance.seed, scene.portable, warp, hash_instance(instance), len(files), size)


def _check_output_folder(out: Path) -> None:
    """Raise ``InputError`` unless ``out`` is new, empty or an earlier export."""
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise InputError(f"cannot write {out}: it is {'a link' if out.is_symlink() else 'no folder'}", _REMEDY)
    try:
        names = {entry.name for entry in out.iterdir()} if out.is_dir() else set[str]()
        foreign, scene, mark = sorted(names - {SCENE, README, INSTANCE, ASSETS}), out / SCENE, f'<text name="{_MARK}"'
        if foreign or (names and not (scene.is_file() and mark.encode() in read_bytes(scene, most=_MOST))):
            what = f"something else, {foreign[0]}" if foreign else "something else than an export"
            raise InputError(f"{out} holds {what}", _REMEDY)
    except OSError as error:
        raise unwritable_error(out, error) from error


def _write_folder(folder: Path, scene: MjcfScene, task: TaskFolder) -> None:
    """Write a new folder."""
    folder.mkdir()
    try:
        root = ElementTree.fromstring(scene.spec.to_xml())
        # Every mesh and texture is copied, equal files once.
        names: dict[str, str] = {}
        robot = Path(scene.instance.robot).parent
        for tag, elements in (("mesh", scene.spec.meshes), ("texture", scene.spec.textures)):
            # The library's files are absolute, those of a user's own arm relative to it.
            paths = {part.name: robot / str(getattr(part.compiler, f"{tag}dir")) / str(part.file) for part in elements}
            for element in root.iterfind(f"asset/{tag}[@file]"):
                path = paths[element.attrib["name"]]
                data = read_bytes(path)
                digest = hashlib.sha256(data).hexdigest()
                if digest not in names:
                    stem = re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)[:60]
                    names[digest] = f"{ASSETS}/{stem}_{digest[:10]}{path.suffix.lower()}"
                    write_bytes(folder / names[digest], data)
                element.set("file", names[digest])
        if scene.portable:
            # MuJoCo 4 always does multiccd and does not write it; with a single contact point bodies creep.
            option = root.find("option")
            assert option is not None, "a world has options of its own"
            flag = option.find("flag")
            (ElementTree.SubElement(option, "flag") if flag is None else flag).set("multiccd", "enable")
        write_text(folder / SCENE, ElementTree.tostring(root, encoding="unicode") + "\n")
        model: Any = mujoco.MjModel.from_xml_path(str(folder / SCENE))
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the scene: {str(error)[:150]}", "mend what it names") from error
    write_bytes(folder / INSTANCE, read_bytes(task.files[scene.instance.seed]))
    file = task.path / "task.json"
    stated: Mapping[str, Any] = read_json(file, "restore it") if file.is_file() else {}
    words = Words(str(stated.get("task-name", "")), str(stated.get("task-description", "")))
    write_text(folder / README, write_readme_text(scene, model, task.library, words))
