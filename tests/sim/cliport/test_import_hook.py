"""The hook changes the process it is switched on in, so each test asks a process of its own."""

import subprocess
import sys

IMPORTS = """
import pybullet as p
from cliport.environments.environment import Environment
from cliport.tasks import Task as Short
from cliport.tasks import primitives
from cliport.tasks.grippers import Spatula
from cliport.tasks.task import Task
from cliport.utils import utils
from cliport.utils.utils import COLORS
import cliport.utils.utils as again
from grs_agents import sim
assert Task is Short and issubclass(Task, sim.Task) and Environment is sim.Environment and p is sim.p
assert utils is again is sim.utils and COLORS is sim.utils.COLORS
assert callable(primitives.push) and callable(primitives.PickPlace) and Spatula
"""
INSTALL = "from grs_agents.sim.cliport import import_hook; import_hook.install(); import_hook.install()\n"


def ask(program: str, path: str = "") -> subprocess.CompletedProcess[str]:
    prelude = f"import sys; sys.path.insert(0, {path!r})\n" if path else ""
    return subprocess.run([sys.executable, "-c", prelude + program], capture_output=True, text=True, check=False)


def test_the_original_import_lines_reach_the_same_objects() -> None:
    done = ask(INSTALL + IMPORTS)
    assert done.returncode == 0, done.stderr


def test_it_is_off_unless_it_is_switched_on(tmp_path) -> None:
    (tmp_path / "pybullet.py").write_text("real = True")
    done = ask("import grs_agents.sim, pybullet; assert pybullet.real", str(tmp_path))
    assert done.returncode == 0, done.stderr


def test_installed_packages_are_never_imported(tmp_path) -> None:
    for package in ("cliport", "cliport/tasks", "pybullet_data"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise SystemExit('the real one')")
    (tmp_path / "cliport" / "tasks" / "stack.py").write_text("")
    (tmp_path / "pybullet.py").write_text("raise SystemExit('the real one')")
    done = ask(INSTALL + IMPORTS, str(tmp_path))
    assert done.returncode == 0, done.stderr
    for name in ("cliport.tasks.stack", "pybullet_data"):
        done = ask(f"{INSTALL}import {name}", str(tmp_path))
        assert f"ModuleNotFoundError: there is no {name} in this simulation" in done.stderr
        assert "cliport.tasks.task" in done.stderr
