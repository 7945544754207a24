"""``grs export``."""

import shlex
from pathlib import Path

from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.tasks.export.mjcf_folder import export_mjcf
from grs_agents.tasks.task_folder import open_task_folder


def export_task(run: Path, seed: int | None, portable: bool, out: Path | None, as_json: bool) -> None:
    """Write a task instance as a folder for MuJoCo, beside the run if nothing else is named, and say where it is."""
    task = open_task_folder(run)
    beside = run.resolve()
    out = out.absolute() if out else beside.with_name(f"{beside.name}-mjcf{'-portable' if portable else ''}")
    made = export_mjcf(task, out, seed, portable)
    if as_json:
        value = {
            "folder": str(made.folder),
            "scene": str(made.scene),
            "seed": made.seed,
            "portable": made.portable,
            "instance_hash": made.instance_hash,
            "files": made.files,
            "bytes": made.size,
        }
        print_json(value)
    else:
        print_escaped(f"{made.folder}: seed {made.seed}, {made.files} files, {made.size / 2**20:.1f} MiB")
        command = shlex.join(["python", "-m", "mujoco.viewer", f"--mjcf={made.scene}"])
        print_escaped(f"open it: {command}")
