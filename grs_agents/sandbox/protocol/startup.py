"""Start of the sandbox's processes: settings, environment, command line, and first steps."""

import os
import socket
import sys
from pathlib import Path
from typing import Literal

from grs_agents.base import Frozen, content

EXPLAIN = b"explain"
"""Message by which the host makes a child write its stack and end."""
ENVIRONMENT = {
    "LC_ALL": "C.UTF-8",
    "PYTHONHASHSEED": "0",  # sets of strings iterate alike in every run
    "MALLOC_ARENA_MAX": "2",
    "OMP_NUM_THREADS": "1",  # a process with threads cannot be forked safely
    "OPENBLAS_NUM_THREADS": "1",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",  # looking for them reads every installed distribution
}
"""All that a worker finds in its environment, besides the folder it works in: nothing of the host's."""


class Settings(Frozen):
    """Settings of a zygote."""

    preload: tuple[str, ...] = ()  # modules to import before the first call; "module:function" is called too,
    # with the JSON list of "module:function:arguments"
    overlays: tuple[Path, ...] = ()  # content folders of the user, laid over the shipped content from the start
    tools: tuple[str, ...] = ()  # tool files to import before the first call
    layers: bool = True  # children harden themselves with Landlock, seccomp and without privileges
    readable: tuple[Path, ...] = ()  # files and folders that children may read
    writable: tuple[Path, ...] = ()  # folders that they may write to, beside their scratch folder
    scratch: Path  # folder with a scratch folder for each slot, named by its number
    slots: int = 1  # calls that may run at once
    scratch_is_sized: bool = False  # each of these is a file system of its own, of `scratch_bytes`
    scratch_bytes: int = 0  # the size of such a file system
    # empty if children are forked. Otherwise each call has a process that was started for it alone, ahead of time: for
    # each slot, the prefix of the command of its processes.
    single_use: tuple[tuple[str, ...], ...] = ()


_CODE = (
    "import gc, sys; gc.disable(); "  # nothing that imports make is garbage
    "path = sys.argv.pop(1); path in sys.path or sys.path.insert(0, path); "
    "from grs_agents.sandbox.harness.{} import main; main()"
)


def build_command_line(module: Literal["zygote", "child_process"], channel: int, settings: Settings) -> list[str]:
    """The command line that runs ``main`` of ``module``; ``channel`` is the number of an inherited socket.

    The process that starts it holds the socket's other end.
    """
    folder = str(content.package_root().parent)
    code = _CODE.format(module)
    return [sys.executable, "-s", "-P", "-B", "-c", code, folder, str(channel), settings.model_dump_json()]


def read_startup_arguments() -> tuple[socket.socket, Settings]:
    """In the new process: the socket to its starter, and the settings; its environment holds nothing else."""
    channel, text = sys.argv[1:]
    sys.argv = ["sandbox"]
    for name in os.environ.keys() - ENVIRONMENT.keys():  # variables added by bubblewrap
        del os.environ[name]
    return socket.socket(fileno=int(channel)), Settings.model_validate_json(text)
