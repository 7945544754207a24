"""What several test folders share: the sample scene and a small one."""

import fcntl
import gc
import json
import os
import sys
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from evals.synthesis import Recipe, synthesise
from grs_agents.base import content
from grs_agents.library.library import Library
from grs_agents.runs.sandbox_setup import PRELOAD
from tests.cli.command import grs
from tests.kept_sandbox import LentReader, note_preloads
from tests.slow import SLOW

pytest_plugins = ("tests.needs",)

INSTRUMENTS = tuple(f"tests/{name}" for name in ("evals/", "examples/", "scripts/", "test_notebook", "test_packaging"))
"""Tests of experiments, scripts, the notebook and the packages: slow as a whole."""

gc.disable()  # until all is imported and collected, which stays to the end
settings.register_profile("grs", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("grs")  # how fast an example is drawn tells of the machine's load, not of the code


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--hostile-programs", type=int, default=25, help="programs that attack the host's readers, six messages each"
    )
    parser.addoption("--kills", type=int, default=1, help="moments of a run at which it is killed")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect in one process after the other where nothing is compiled: the second reads what the first compiled."""
    last = Path(__file__).with_name("views") / "__pycache__"
    with Path(__file__).open("rb") as lock:
        if not (sys.dont_write_bytecode or last.exists()):
            fcntl.flock(lock, fcntl.LOCK_EX)
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    # These fork their process for each check: first, while it is small, as a fork copies its page tables.
    items.sort(key=lambda item: not item.nodeid.startswith("tests/sandbox/isolation/"))
    for item in items:
        if item.nodeid.startswith(INSTRUMENTS):
            item.add_marker(SLOW)


def pytest_collection_finish() -> None:
    """What was imported and collected stays to the end: no collector looks at it again, nor copies it in a fork."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """The inodes that the disk was asked to hold."""
    inodes: set[int] = set()
    flush = os.fsync

    def flush_and_note(descriptor: int) -> None:
        flush(descriptor)
        inodes.add(os.fstat(descriptor).st_ino)

    monkeypatch.setattr(os, "fsync", flush_and_note)
    return inodes


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all processes of the session share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session", autouse=True)
def _cache(shared_folder: Path) -> Iterator[None]:
    """What one run keeps for the next is shared by the session's processes, and does not go to the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(shared_folder / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def _lent_readers(_cache: None) -> Iterator[None]:
    """Strangers' files are read by workers of zygotes that are kept: each would import and be attacked anew."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (
            "library.importing.item_worker",
            "perception.reading.foreign_scene",
            "sim.arms.arm_files",
            "sim.arms.urdf_arm",
            "views.common.foreign_decoding",
        ):
            patch.setattr(f"grs_agents.{module}.ForeignReader", LentReader)
        yield


def made_once(folder: Path, make: Callable[[], object]) -> Path:
    """A folder that the first process of the session makes, and those that come meanwhile wait for."""
    folder.parent.mkdir(exist_ok=True)
    with folder.with_name(f"{folder.name}.made").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not os.fstat(lock.fileno()).st_size:  # as it is now, not as it was when this process began to wait
            make()
            lock.write("made")
    return folder


@pytest.fixture(scope="session")
def sample_scene() -> Path:
    """The scene that ships with GRS."""
    return content.content_path("assets", "scenes") / "groceries"


@pytest.fixture(scope="session")
def small_scene(shared_folder: Path) -> Path:
    """Three things of the library in a picture of 320 x 240: for runs that are not about what is seen."""
    recipe = Recipe(seed=3, objects=3, distractors=0, tilt=50.0, sensor="time_of_flight", width=320, height=240)
    folder = shared_folder / "scenes" / "small"
    return made_once(folder, lambda: synthesise(recipe, Library()).write(folder))


@pytest.fixture(scope="session")
def known_scene(shared_folder: Path, small_scene: Path) -> Path:
    """That scene, comprehended once: for runs that begin with the task."""
    folder = shared_folder / "known" / "small"

    def comprehend() -> None:
        done = grs("scene", str(small_scene), "--out", "small", folder=folder.parent)
        assert done.returncode == 0, done.stderr

    return made_once(folder, comprehend)


@pytest.fixture(scope="session")
def accepted_run(shared_folder: Path, known_scene: Path) -> Path:
    """An accepted run of that scene with one seed, made once: to be read as it is, or copied and changed."""
    folder = shared_folder / "accepted" / "run"

    def run() -> None:
        done = grs("run", str(known_scene), "--out", "run", "--set", "audit.seeds=1", "--json", folder=folder.parent)
        assert done.returncode == 0, done.stderr

    return made_once(folder, run)


@pytest.fixture(scope="session")
def sample_run(shared_folder: Path) -> Path:
    """An accepted run of the sample scene, by its name, made once: to be copied. ``printed.json`` is beside it."""
    folder = shared_folder / "sample" / "run"

    def run() -> None:
        with note_preloads() as preloads:
            done = grs("run", "groceries", "--out", "run", "--json", folder=folder.parent, own_sandbox=True)
        assert done.returncode == 0, done.stderr
        assert preloads == [PRELOAD]  # the run's own assets need no second zygote
        (folder.parent / "printed.json").write_text(done.stdout)

    return made_once(folder, run)


def shorten_films(patch: pytest.MonkeyPatch) -> None:
    """Give the film in a report few pictures, drawn without a graphics library."""
    patch.setattr("grs_agents.views.film.rollout_film._BACKENDS", ("rays",))
    patch.setattr("grs_agents.views.report.pictures.FILM_RATE", 0.2)


@pytest.fixture
def brief_films(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short films, for tests that are not about films."""
    shorten_films(monkeypatch)


@pytest.fixture
def scene_folder(tmp_path: Path) -> Callable[..., Path]:
    """Writes a valid little scene folder; keyword arguments replace what it holds."""

    def write(
        camera: object = None,
        rgb: np.ndarray | bytes | None = None,
        depth: np.ndarray | bytes | None = None,
        **changes: object,
    ) -> Path:
        values: dict[str, object] = {"fx": 50.0, "fy": 50.0, "cx": 16.0, "cy": 12.0, "width": 32, "height": 24}
        values |= {"depth_scale": 0.001} | changes
        values = {key: value for key, value in values.items() if value is not ...}
        (tmp_path / "camera.json").write_text(json.dumps(values) if camera is None else str(camera))
        for name, given, usual in (
            ("rgb.png", rgb, np.full((24, 32, 3), 90, np.uint8)),
            ("depth.png", depth, np.full((24, 32), 800, np.uint16)),
        ):
            content = usual if given is None else given
            data = content if isinstance(content, bytes) else cv2.imencode(".png", content)[1].tobytes()
            (tmp_path / name).write_bytes(data)
        return tmp_path

    return write


@pytest.fixture(autouse=True)
def _no_open_recording() -> Iterator[None]:
    """Each test closes its recordings: rerun may block those that come after it."""
    yield
    if (module := sys.modules.get("grs_agents.views.rerun.recording")) is not None:
        assert not module.RerunRecording._open


@pytest.fixture(autouse=True)
def _no_user_configuration(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tests see neither the user's keys nor a ``GRS_*`` environment."""
    for name in list(os.environ):
        if name.startswith("GRS_") or name.endswith("_API_KEY"):
            monkeypatch.delenv(name)
    yield
