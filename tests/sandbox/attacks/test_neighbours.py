"""Two calls at once, of one sandbox: neither sees, stops nor slows the other."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from grs_agents.base import content
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.protocol.report import CallResult
from tests.sandbox.attacks.conftest import BOUNDS, Door, bounds
from tests.sandbox.attacks.world import Canaries

NEIGHBOUR = """
import os, time
secret = request["secret"]
open("secret", "w").write(secret)
os.environ["SECRET"] = secret
print(secret, flush=True)
time.sleep(0.8)
value = {"got": open("secret").read() == secret and sorted(os.listdir("."))}
"""
LOOK = """
import contextlib, os, time
from pathlib import Path
found, me, own = [], os.getpid(), os.fstat(1)
end = time.monotonic() + 0.5
while time.monotonic() < end and not found:
    for slot in range(4):
        for folder in (Path("..", str(slot)), Path("/scratch", str(slot))):
            with contextlib.suppress(OSError):
                if not os.path.samefile(folder, "."):
                    found += [str(path) for path in folder.iterdir()]
                    (folder / "planted").write_text("x")
            with contextlib.suppress(OSError):
                if not os.path.samefile(folder, "."):
                    found.append((folder / "secret").read_text())
    for pid in [*range(1, 64), *range(me - 32, me + 32)]:
        if pid == me:
            continue
        for name in ("environ", "mem", "maps", "fd/1", "cwd/secret", "root/etc/hostname"):
            with contextlib.suppress(OSError):
                opened = os.open(f"/proc/{pid}/{name}", os.O_RDONLY)
                if os.fstat(opened) != own:  # a thread of this process that is just ending has a number too
                    found.append(f"/proc/{pid}/{name}")
        if pid > 1:
            with contextlib.suppress(OSError):
                os.kill(pid, 0)
                found.append(f"could signal {pid}")
value = {"got": found}
"""
HOGS = {
    "memory": "x = []\nwhile True: x.append(bytearray(1 << 20))",
    "disk": "n = 0\nwhile True: open(str(n), 'wb').write(bytes(1 << 20)); n += 1",
    "crash": "import ctypes; ctypes.string_at(0)",
    "output": "while True: print('x' * 1000)",
    "threads": "import threading\nwhile True: threading.Thread(target=threading.Event().wait, daemon=True).start()",
    "descriptors": "import os\nos.closerange(0, 256)\nwhile True: pass",
}


@pytest.fixture(scope="module")
def house(door: Door, tool_folder: Path) -> Iterator[Sandbox]:
    """A sandbox that serves two at once."""
    with Sandbox(backend=door.backend, workers=2, limits=BOUNDS) as shared, pytest.MonkeyPatch.context() as patch:
        patch.setattr(content, "_overlays", [tool_folder])
        assert shared.call("execute", {"code": ""}).outcome == "ok"
        yield shared


def beside(house: Sandbox, canaries: Canaries, code: str) -> tuple[CallResult, CallResult]:
    """The results of the neighbour and of the code that ran beside it."""
    request = {"code": NEIGHBOUR, "secret": canaries.secret}
    with ThreadPoolExecutor(2) as pool:
        neighbour: Future[CallResult] = pool.submit(house.call, "execute", request, bounds())
        other = house.call("execute", {"code": code}, bounds(wall_seconds=3))
        return neighbour.result(), other


def test_a_neighbour_is_not_found(house: Sandbox, watched: Canaries) -> None:
    neighbour, other = beside(house, watched, LOOK)
    assert (neighbour.outcome, neighbour.value) == ("ok", {"got": ["secret"]}), neighbour.error
    assert (other.outcome, other.value) == ("ok", {"got": []}), other.error
    assert watched.secret not in repr(other)


@pytest.mark.parametrize("name", HOGS)
def test_a_neighbour_does_not_suffer(name: str, house: Sandbox, watched: Canaries) -> None:
    neighbour, other = beside(house, watched, HOGS[name])
    assert (neighbour.outcome, neighbour.value, neighbour.retried) == ("ok", {"got": ["secret"]}, False), neighbour
    assert other.outcome != "ok"
    assert neighbour.output == f"{watched.secret}\n"
