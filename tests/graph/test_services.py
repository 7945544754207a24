"""What the nodes work with."""

from pathlib import Path
from typing import Any, cast

import pytest

from grs_agents.base.config.schema import Config
from grs_agents.graph.services import Services
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy

GRAY = (0.5, 0.5, 0.5)


@pytest.fixture
def services(tmp_path: Path) -> Services:
    """The services of a run that asks no model and runs no code."""
    nothing = cast(Any, None)
    return Services(Config(), log=nothing, agents=nothing, policy=nothing, sandbox=nothing, folder=tmp_path)


def test_the_library_is_read_once(services: Services) -> None:
    shipped = services.library
    assert services.library is shipped and "HOPE/Milk.urdf" in shipped
    write_proxy(services.folder / "assets", "mug", primitive_proxy("box", (0.08, 0.08, 0.1), GRAY), "a mug")
    laid = services.library
    assert laid is not shipped and services.library is laid
    assert "proxy/mug.urdf" in laid and "proxy/mug.urdf" not in shipped


def test_a_proxy_that_is_written_again_is_read_again(services: Services) -> None:
    for height in (0.1, 0.2):  # texts of one length
        write_proxy(services.folder / "assets", "mug", primitive_proxy("box", (0.08, 0.08, height), GRAY), "a mug")
        assert services.library.load_object_model("proxy/mug.urdf").size[2] == pytest.approx(height)
        assert services.library.asset("proxy/mug.urdf").size[2] == pytest.approx(height)
