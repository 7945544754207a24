"""Opening a recording in the rerun viewer, which listens on the loopback address only."""

import contextlib
import importlib.util
import os
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from urllib.parse import quote

from grs_agents.base.errors import GrsError, InputError

LOOPBACK = "127.0.0.1"  # rerun's own default is every address of the machine
WEB_PORT = 9090
_SETTLED = 1.5  # seconds after which a viewer that still runs is taken to have started


def find_rerun_program() -> Path:
    """The viewer program of ``rerun-sdk``, located without importing rerun."""
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
            if (Path(folder) / name).is_file():
                return Path(folder) / name
    raise GrsError("the rerun viewer is not installed", "run: pip install rerun-sdk")


def find_recordings(path: Path) -> list[Path]:
    """The recording files of a run folder, parts of a resumed run included; or ``path`` itself."""
    files = sorted(path.glob("trace*.rrd")) if path.is_dir() else [path]
    if not files or not files[0].is_file():
        raise InputError(f"no recording in {path}", "name a run folder that holds trace.rrd")
    return files


@dataclass(frozen=True)
class WebAddress:
    """Loopback ports of a browser viewer's page and of its data."""

    page: int
    data: int

    @classmethod
    def with_free_ports(cls) -> "WebAddress":
        """Free ports; the usual page port if it is free."""
        with socket.socket() as probe:
            taken = probe.connect_ex((LOOPBACK, WEB_PORT)) == 0
        return cls(_find_free_port() if taken else WEB_PORT, _find_free_port())

    @property
    def url(self) -> str:
        """URL of the page."""
        data = quote(f"rerun+http://{LOOPBACK}:{self.data}/proxy", safe="")
        return f"http://{LOOPBACK}:{self.page}?url={data}"


def viewer_command(path: Path, web: WebAddress | None = None) -> list[str]:
    """Command that opens a recording in a window, or in a browser with its data from standard input (`open_viewer`)."""
    place = ["--bind", LOOPBACK, "--port", str(web.data) if web else "auto"]
    if web:
        place += ["--web-viewer", "--web-viewer-port", str(web.page)]
    return [str(find_rerun_program()), *place, *(["-"] if web else map(str, find_recordings(path)))]


def viewer_environment() -> dict[str, str]:
    """Environment in which rerun sends no usage data.
    Apart from a file in the user's home, its only switch is ``CI``, which marks a build machine."""
    return {**{key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}, "CI": "1"}


def has_display(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """True if a window can open; on Linux that needs X11 or Wayland."""
    return not platform.startswith("linux") or bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def open_live_viewer() -> tuple[subprocess.Popen[bytes], str]:
    """Open an empty viewer window. Returns: its process, and the address for recordings."""
    if not has_display():
        raise InputError("no display to open the viewer on", "leave --view out, and open the run later: grs replay RUN")
    port = _find_free_port()
    command = [str(find_rerun_program()), "--bind", LOOPBACK, "--port", str(port), "--expect-data-soon"]
    return _start_viewer(command), f"rerun+http://{LOOPBACK}:{port}/proxy"


def _find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def open_viewer(path: Path, web: WebAddress | None = None) -> Generator[subprocess.Popen[bytes]]:
    """Open a recording in a window, or in the browser at ``web``; the viewer ends with the context."""
    command = viewer_command(path, web)
    if web is None and not has_display():
        files = shlex.join(file.name for file in find_recordings(path))
        remedy = f"add --web, or copy {files} to a machine with a screen and run there: rerun {files}"
        raise InputError("no display to open the viewer on", remedy)
    process = _start_viewer(command, find_recordings(path) if web else ())
    try:
        yield process
    finally:
        _stop_process(process)


def _stop_process(process: subprocess.Popen[bytes]) -> None:
    """End a process that may have ended already."""
    process.terminate()
    try:
        process.wait(_SETTLED)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _start_viewer(command: list[str], fed: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
    """Start a viewer with the files ``fed`` on its standard input. Raises GrsError: it ended at once. Standard input
    stays open as long as the process object lives: after the end of all its sources, rerun's server keeps a
    processor core busy."""
    with tempfile.TemporaryFile() as output, contextlib.ExitStack() as interrupted:
        stdin = subprocess.PIPE if fed else subprocess.DEVNULL
        process = subprocess.Popen(command, stdin=stdin, stdout=output, stderr=output, env=viewer_environment())
        interrupted.callback(_stop_process, process)
        Thread(target=_feed_stdin, args=(process, fed), daemon=True).start()
        try:
            process.wait(_SETTLED)
        except subprocess.TimeoutExpired:
            interrupted.pop_all()
            return process
        output.seek(0)
        lines = output.read().decode("utf-8", "replace").strip().splitlines()
    if process.returncode == 0:  # closed by the user, or handed over to a viewer that was open
        return process
    reason = lines[-1] if lines else f"exit status {process.returncode}"
    raise GrsError(f"the viewer ended at once: {reason}", f"try: {shlex.join(command)}")


def _feed_stdin(process: subprocess.Popen[bytes], files: Sequence[Path]) -> None:
    for path in files:
        with path.open("rb") as file, contextlib.suppress(BrokenPipeError):
            if process.stdin is not None:
                shutil.copyfileobj(file, process.stdin)
                process.stdin.flush()
