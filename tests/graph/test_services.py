"""What the nodes work with."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from grs_agents.base.config.schema import Config
from grs_agents.graph.services import Services
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy
from tests.gantry import GANTRY

GRAY = (0.5, 0.5, 0.5)


@pytest.fixture
def services(tmp_path: Path) -> Services:
    """The services of a run that asks no model and runs no code."""
    nothing = cast(Any, None)
    return Services(Config(), log=nothing, agents=nothing, policy=nothing, sandbox=nothing, folder=tmp_path)


def test_the_arm_of_a_user_is_loaded_ahead_of_the_calls(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(GANTRY)
    preloads: list[tuple[Any, ...]] = []
    sandbox, nothing = SimpleNamespace(preload=lambda *call: preloads.append(call)), cast(Any, None)
    config = Config(robot=str(tmp_path / "arm.xml"))
    Services(config, log=nothing, agents=nothing, policy=nothing, sandbox=cast(Any, sandbox), folder=tmp_path / "run")
    copy = tmp_path / "run/robot/arm.xml"
    assert preloads == [("grs_agents.sim.arms.registry:prepare_arm", (str(copy), "suction"), [copy.parent])]


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
    models = [services.library.load_object_model(name) for name in ("proxy/mug.urdf", "HOPE/Milk.urdf")]
    write_proxy(services.folder / "assets", "box", primitive_proxy("box", (0.1, 0.1, 0.1), (0.1, 0.1, 0.8)), "a box")
    for kept, name in zip(models, ("proxy/mug.urdf", "HOPE/Milk.urdf"), strict=True):
        assert services.library.load_object_model(name) is kept
