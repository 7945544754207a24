"""How the processes of the sandbox start: their command line, and what they do before anything else."""

import os
import socket
import sys
from typing import Literal

from grs_agents import content
from grs_agents.sandbox.protocol.settings import ENVIRONMENT, Settings

_CODE = (
    "import sys; path = sys.argv.pop(1); path in sys.path or sys.path.insert(0, path); "
    "from grs_agents.sandbox.harness.{} import main; main()"
)


def command(module: Literal["zygote", "worker"], channel: int, settings: Settings) -> list[str]:
    """The command line that runs ``main`` of ``module``.

    Args:
        module: which process to start.
        channel: the number of an inherited socket, whose other end whoever starts the process holds.
        settings: how it serves.
    """
    folder = str(content.package_root().parent)
    code = _CODE.format(module)
    return [sys.executable, "-s", "-P", "-B", "-c", code, folder, str(channel), settings.model_dump_json()]


def begin() -> tuple[socket.socket, Settings]:
    """In the new process: the socket to whoever started it, and the settings; its environment holds nothing else."""
    channel, text = sys.argv[1:]
    sys.argv = ["sandbox"]
    for name in os.environ.keys() - ENVIRONMENT.keys():  # what bubblewrap added
        del os.environ[name]
    return socket.socket(fileno=int(channel)), Settings.model_validate_json(text)
