"""All layers together: harm fails, work goes on."""

import errno
import faulthandler
import gc
import importlib
import os
import random
import resource
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.sandbox.isolation import hardening, kernel, landlock, seccomp
from grs_agents.sandbox.isolation.privileges import Allowance
from tests.needs import needs
from tests.sandbox.confined import NOBODY, PACKAGE, PYTHON, USERS, Got, forked, hardened

pytestmark = needs("landlock 6", "seccomp")

Confined = Callable[[Callable[[], object]], Got]


@pytest.fixture(params=USERS)
def user(request: pytest.FixtureRequest) -> str:
    return request.param


TEMPORARY = tempfile.gettempdir()
"""The system's, whatever other tests set meanwhile: their own folders are closed to other users."""


@pytest.fixture
def scratch(user: str) -> Iterator[Path]:
    """A folder of the user's, whose parents everybody may pass."""
    with tempfile.TemporaryDirectory(dir=TEMPORARY) as folder:
        if user == "nobody":
            os.chown(folder, NOBODY, NOBODY)
        yield Path(folder)


@pytest.fixture
def confined(user: str, scratch: Path) -> Confined:
    return lambda check: hardened(check, user, writable=[scratch])


def test_the_layers_that_hold(user: str, scratch: Path) -> None:
    layers = forked(
        lambda: list(hardening.harden_process(hardening.create_file_rules(PYTHON, [scratch]), Allowance()))
    ).value
    assert layers == ["no capabilities", "limits", "thread limit", f"landlock {landlock.abi_version()}", "seccomp"]


def test_several_threads_are_refused_before_anything_is_given_up() -> None:
    end = threading.Event()

    def harden_with_a_second_thread() -> None:
        threading.Thread(target=end.wait, daemon=True).start()
        try:
            hardening.harden_process(hardening.create_file_rules(PYTHON, []), Allowance())
        finally:
            assert kernel.prctl(39) == 0  # no_new_privs
            assert Path("/etc/passwd").read_bytes()

    got = forked(harden_with_a_second_thread)
    assert got.error == "HardeningError"
    assert "2 threads" in got.text
    assert "OPENBLAS_NUM_THREADS=1" in got.text


def test_files_are_those_given(confined: Confined, scratch: Path) -> None:
    for path in ("/etc/shadow", "/etc/passwd", "/proc/self/environ", "/proc/1/environ", "/root/.bashrc"):
        assert confined(lambda path=path: Path(path).read_bytes()).error in {"PermissionError", "FileNotFoundError"}
    assert confined(lambda: (PACKAGE / "errors.py").write_text("")).error == "PermissionError"
    assert confined(lambda: (scratch / "file").write_text("abc")).value == 3


@pytest.mark.parametrize(
    "harm",
    [
        os.fork,
        lambda: subprocess.run(["/bin/true"], check=True),
        socket.socket,
        lambda: os.kill(os.getppid(), 0),
        lambda: kernel.make_system_call("ptrace", 0),
        lambda: os.memfd_create("x"),
        lambda: os.chown("/tmp", -1, -1),
        lambda: Path("/tmp").chmod(0o1777),
    ],
    ids=["fork", "program", "socket", "kill", "trace", "memory file", "owner", "permission bits"],
)
def test_harm_is_a_permission_error(confined: Confined, harm: Callable[[], object]) -> None:
    assert confined(harm).error == "PermissionError"


def test_threads_work(confined: Confined) -> None:
    def square() -> list[int]:
        with ThreadPoolExecutor(8) as pool:
            return list(pool.map(lambda number: number * number, range(20)))

    assert confined(square).value == [number * number for number in range(20)]


def test_too_many_threads_are_refused(user: str) -> None:
    def start() -> None:
        threading.stack_size(64 << 10)
        end = threading.Event()
        for _ in range(5000):
            threading.Thread(target=end.wait, daemon=True).start()

    got = hardened(start, user, allowance=Allowance(threads=4))
    assert got.error == "RuntimeError"


def test_numpy_works(confined: Confined) -> None:
    def solve() -> float:
        rng = np.random.default_rng()
        matrix = rng.normal(size=(60, 60))
        vector = rng.normal(size=60)
        return float(np.abs(matrix @ np.linalg.solve(matrix, vector) - vector).max())

    assert confined(solve).value < 1e-6


MODEL = """
<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .5"><freejoint/><geom type="box" size=".1 .1 .1" rgba="1 0 0 1"/></body></worldbody></mujoco>
"""


def test_mujoco_works(confined: Confined) -> None:
    def fall() -> float:
        model = mujoco.MjModel.from_xml_string(MODEL)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 500)
        return float(data.qpos[2])

    assert confined(fall).value == pytest.approx(0.1, abs=0.01)


def test_mujoco_reads_no_file_but_those_given(confined: Confined) -> None:
    def include() -> None:
        mujoco.MjModel.from_xml_string('<mujoco><include file="/etc/passwd"/></mujoco>')

    assert confined(include).error == "ValueError"


def test_modules_are_imported() -> None:
    def late() -> list[str]:
        names = ["wave", "lzma", "_lzma", "cProfile"]
        for name in names:
            sys.modules.pop(name, None)
        return [importlib.import_module(name).__name__ for name in names]

    assert hardened(late).value == ["wave", "lzma", "_lzma", "cProfile"]


def test_temporary_files_work(confined: Confined, scratch: Path) -> None:
    importlib.import_module("mmap")  # numpy imports it late, and nobody cannot read an interpreter in root's home

    def use() -> list[object]:
        tempfile.tempdir = str(scratch)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "array.npy")
            np.save(file, np.arange(3))
            loaded = np.load(file, mmap_mode="r").tolist()
        with tempfile.NamedTemporaryFile() as named, tempfile.TemporaryFile() as anonymous:
            named.write(b"x")
            anonymous.write(b"y")
            anonymous.truncate(0)
        return [loaded, [path.name for path in scratch.iterdir()]]

    assert confined(use).value == [[0, 1, 2], []]


def test_the_interpreter_works(confined: Confined, scratch: Path) -> None:
    def use() -> list[object]:
        trace = (scratch / "trace").open("w+")
        faulthandler.dump_traceback_later(1000, file=trace)
        faulthandler.cancel_dump_traceback_later()
        faulthandler.dump_traceback(file=trace)
        trace.seek(0)
        garbage: list[object] = []
        garbage.append(garbage)
        del garbage
        time.sleep(0.001)
        return [
            "test_hardening" in trace.read(),
            gc.collect() > 0,
            time.time() > 0 and time.perf_counter() > 0 and time.process_time() > 0,
            0 <= random.random() < 1,
            len(os.urandom(8)),
            os.cpu_count() != 0,
            sys.stdout.isatty() is not None,
            resource.getrusage(0).ru_maxrss > 0,
        ]

    assert confined(use).value == [True, True, True, True, 8, True, True, True]


RENDER = """
import sys
from pathlib import Path

import mujoco

from grs_agents.sandbox.isolation import hardening
from grs_agents.sandbox.isolation.privileges import Allowance

model = mujoco.MjModel.from_xml_string(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
hardening.harden_process(hardening.create_file_rules([Path(path) for path in sys.argv[2:]], []), Allowance())
with mujoco.Renderer(model, 48, 64) as renderer:
    renderer.update_scene(data)
    print(renderer.render().max())
"""


@pytest.mark.parametrize("library", [pytest.param(name, marks=needs(name)) for name in ("egl", "osmesa")])
def test_images_are_rendered_in_software(library: str) -> None:
    environment = {"MUJOCO_GL": library, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(PACKAGE.parent)}
    command = [sys.executable, "-c", RENDER, MODEL, *map(str, PYTHON)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 50


def test_an_older_landlock_is_told_and_made_up_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(landlock, "abi_version", lambda: 2)
    library = tmp_path / "library"
    library.write_text("known")
    assert hardening.find_missing_layers().keys() == {"landlock 6"}

    def attempt(flags: int) -> Got:
        return hardened(lambda: os.open(library, flags), readable=[library])

    assert attempt(os.O_RDONLY).error == ""
    assert attempt(os.O_RDONLY | os.O_TRUNC).errno == errno.EPERM
    assert hardened(lambda: os.truncate(library, 0), readable=[library]).errno == errno.EPERM
    assert library.read_text() == "known"


def test_what_a_kernel_lacks_is_left_out_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landlock, "abi_version", lambda: 0)
    monkeypatch.setattr(seccomp, "unavailability_reason", lambda: "no filters")
    layers = forked(lambda: list(hardening.harden_process(hardening.create_file_rules([], []), Allowance()))).value
    assert layers == ["no capabilities", "limits", "thread limit"]
    monkeypatch.setattr(kernel, "detect_architecture", lambda: None)
    assert hardening.find_missing_layers() == {"landlock": landlock.unavailability_reason(), "seccomp": "no filters"}
    assert "x86-64 and aarch64" in landlock.unavailability_reason()


def test_preparing_ahead_of_a_fork_changes_nothing_but_the_cost() -> None:
    def prepare_and_harden() -> list[object]:
        hardening.prepare_hardening_before_fork()
        layers = hardening.harden_process(hardening.create_file_rules(PYTHON, []), Allowance())
        return [len(layers), kernel.prctl(39)]

    assert forked(prepare_and_harden).value == [5, 1]
