"""The command line of Docker: a container of this machine that sees the host's Python and little else.

The container shares no process tree with the host, so the zygote in it connects to a socket in a folder that is
mounted into it; descriptors pass through such a socket between the containers of one machine.
"""

import csv
import io
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from grs_agents.sandbox import allowlist
from grs_agents.sandbox.call import Limits
from grs_agents.sandbox.settings import ENVIRONMENT

_INTERPRETER_MIB = 512
"""What the zygote and each child hold before generated code runs."""
_KILL_SECONDS = 30.0
_REMEDIES = {
    "permission denied": "have this user use the engine (sudo usermod -aG docker $USER, then log in again)",
    "cannot connect": "start the engine (sudo systemctl start docker)",
    "failed to connect": "start the engine (sudo systemctl start docker)",
    "no such image": "docker pull {image}",
    "unable to find image": "docker pull {image}",
}


def wrap(name: str, image: str, mounts: Sequence[Path], scratch: Sequence[Path], limits: Limits) -> list[str]:
    """What to put before the command of a zygote. Images are never downloaded unasked.

    Args:
        name: of the container.
        image: any Linux one; the programs and libraries are the host's.
        mounts: files and folders that are visible beside the system's own, read-only.
        scratch: folders that can be written, each a file system of its own.
        limits: what one call may hold.
    """
    slots, user = len(scratch), (os.getuid(), os.getgid())
    memory = f"{(slots + 1) * _INTERPRETER_MIB + slots * (limits.memory_mib + limits.scratch_mib)}m"
    command = [shutil.which("docker") or "docker", "run", "--rm", "--pull", "never", "--name", name]
    command += ["--network", "none", "--ipc", "none", "--hostname", "sandbox", "--workdir", "/", "--read-only"]
    command += ["--cap-drop", "ALL", "--security-opt", "no-new-privileges", "--user", f"{user[0]}:{user[1]}"]
    command += ["--pids-limit", str(16 + slots * (limits.threads + 2)), "--memory", memory, "--memory-swap", memory]
    for variable, value in ENVIRONMENT.items():
        command += ["--env", f"{variable}={value}"]
    for path in (*_system(), *mounts):
        command += ["--mount", _bind(path)]
    options = f"size={limits.scratch_mib << 20},mode=700,uid={user[0]},gid={user[1]},noexec,nosuid,nodev"
    for folder in scratch:
        command += ["--tmpfs", f"{folder}:{options}"]
    return [*command, "--entrypoint", "", image]


def kill(name: str) -> None:
    """End the container ``name`` if it runs; its engine removes it."""
    command = [shutil.which("docker") or "docker", "kill", name]
    try:
        subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, timeout=_KILL_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):  # the zygote in it ends anyway: its socket is closed
        return


def explain(log: str, image: str) -> tuple[str, str]:
    """What Docker said and what to do about it; both empty if it said nothing of its own."""
    said = next((line for line in log.splitlines() if line.startswith("docker: ")), "").removeprefix("docker: ")
    said = next((line for line in log.splitlines() if line.startswith("Unable to find image")), said)
    remedies = (remedy for sign, remedy in _REMEDIES.items() if sign in said.lower())
    return said, next(remedies, "").format(image=image)


def _system() -> list[Path]:
    """The system's paths; a file that is a link (the time zone) stays the image's, whose link leads elsewhere."""
    return [path for path in allowlist.system_paths() if path.is_dir() or not path.is_symlink()]


def _bind(path: Path) -> str:
    """The CSV that ``--mount`` reads, so that a path may hold any character."""
    text = io.StringIO()
    fields = ["type=bind", f"source={path.resolve()}", f"target={path}", "readonly"]
    csv.writer(text, lineterminator="").writerow(fields)
    return text.getvalue()
