"""Robots of MuJoCo Menagerie by name, from a checkout."""

import sys
from pathlib import Path

import pytest

from grs_agents.base.config.load import load_config
from grs_agents.base.errors import ConfigError, UnknownNameError
from grs_agents.sim.arms.registry import get_arm
from tests.gantry import GANTRY
from tests.needs import needs


@needs("mujoco_menagerie")
def test_a_robot_of_menagerie_is_the_file_of_its_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "franka_emika_panda"
    folder.mkdir()
    (folder / "panda.xml").write_text(GANTRY)
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    chosen = load_config(settings=["robot=menagerie:franka_emika_panda"]).config
    assert chosen.robot == str(folder / "panda.xml") and get_arm(chosen.robot).dof == 4
    with pytest.raises(ConfigError, match=r"panda_nohand\.xml"):
        load_config(settings=["robot=menagerie:franka_emika_panda/panda_nohand"])
    with pytest.raises(UnknownNameError, match="panda_nohand"):
        load_config(settings=["robot=menagerie:franka_emika_panda/scene"])
    with pytest.raises(UnknownNameError, match="franka_emika_panda"):
        load_config(settings=["robot=menagerie:franka_panda"])
    with pytest.raises(ConfigError, match="MENAGERIE_ROOT"):
        load_config(settings=["robot=menagerie:universal_robots_ur5e"])


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(ConfigError, match="needs mujoco-menagerie"):
        load_config(settings=["robot=menagerie:franka_emika_panda"])
