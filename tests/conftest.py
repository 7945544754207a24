"""What several test folders share: the sample scene, real captures, and a loopback model server."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from grs_agents import content

REPOSITORY = Path(__file__).parents[1]
REAL_SCENES = REPOSITORY.parent / "shared" / "scenes"

settings.register_profile("grs", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("grs")  # how fast an example is drawn tells of the machine's load, not of the code


@pytest.fixture(scope="session")
def sample_scene() -> Path:
    """The scene that ships with GRS."""
    return content.path("assets", "scenes") / "groceries"


@pytest.fixture(scope="session")
def real_scenes() -> Path:
    """Real captures beside the repository; tests that need them skip where they are absent."""
    if not REAL_SCENES.is_dir():
        pytest.skip("no folder of real captures beside the repository")
    return REAL_SCENES


@pytest.fixture(autouse=True)
def _no_user_configuration(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tests see neither the user's keys nor a ``GRS_*`` environment."""
    import os

    for name in list(os.environ):
        if name.startswith("GRS_") or name.endswith("_API_KEY"):
            monkeypatch.delenv(name)
    yield
