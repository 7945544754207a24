"""What several test folders share: the sample scene and a small one."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from grs_agents import content
from grs_agents.library import Library
from grs_agents.synth import Recipe, synthesise

pytest_plugins = ("tests.needs",)

settings.register_profile("grs", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("grs")  # how fast an example is drawn tells of the machine's load, not of the code


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--hostile-programs", type=int, default=25, help="programs that attack the host's readers, six messages each"
    )


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What one run keeps for the next is shared by the session's processes, and does not go to the user's folder."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield


@pytest.fixture(scope="session")
def sample_scene() -> Path:
    """The scene that ships with GRS."""
    return content.path("assets", "scenes") / "groceries"


@pytest.fixture(scope="session")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three things of the library in a picture of 320 x 240: for runs that are not about what is seen."""
    folder = tmp_path_factory.mktemp("scenes") / "small"
    recipe = Recipe(seed=3, objects=3, distractors=0, tilt=50.0, sensor="time_of_flight", width=320, height=240)
    synthesise(recipe, Library()).write(folder)
    return folder


@pytest.fixture(autouse=True)
def _no_user_configuration(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tests see neither the user's keys nor a ``GRS_*`` environment."""
    for name in list(os.environ):
        if name.startswith("GRS_") or name.endswith("_API_KEY"):
            monkeypatch.delenv(name)
    yield
