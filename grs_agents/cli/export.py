"""``grs export``."""

import shlex
from pathlib import Path

from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.tasks.export.mjcf_folder import export_mjcf
from grs_agents.tasks.task_folder import open_task_folder


def export_task(run: Path, seed: int | None, portable: bool, warp: bool, out: Path | None, as_json: bool) -> None:
    """Write a task instance as a folder for MuJoCo, by default beside the run, and print its path."""
    task = open_task_folder(run)
    beside = run.resolve()
    form = "-warp" if warp else "-portable" if portable else ""
    out = out.absolute() if out else beside.with_name(f"{beside.name}-mjcf{form}")
    export = export_mjcf(task, out, seed, portable, warp)
    if as_json:
        value = {
            "folder": str(export.folder),
            "scene": str(export.scene),
            "seed": export.seed,
            "portable": export.portable,
            "warp": export.warp,
            "instance_hash": export.instance_hash,
            "files": export.files,
            "bytes": export.size,
        }
        print_json(value)
    else:
        print_escaped(f"{export.folder}: seed {export.seed}, {export.files} files, {export.size / 2**20:.1f} MiB")
        command = shlex.join(["python", "-m", "mujoco.viewer", f"--mjcf={export.scene}"])
        print_escaped(f"open it: {command}")
