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
import transforms3d
import transforms3d.taitbryan
from transforms3d import affines, axangles, euler
from transforms3d.quaternions import mat2quat
from transforms3d.utils import normalized_vector
from grs_agents import sim
assert Task is Short and issubclass(Task, sim.Task) and Environment is sim.Environment and p is sim.p
assert utils is again is sim.utils and COLORS is sim.utils.COLORS
assert transforms3d.euler is euler and euler.euler2quat(0, 0, 0).tolist() == [1, 0, 0, 0]
assert callable(transforms3d.affines.decompose44) and callable(axangles.axangle2mat)
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
    unanswered = (
        "cliport.tasks.stack",
        "pybullet_data",
        "cliport.tasks.put_block_in_bowl.deeper",
        "transforms3d.zooms",
    )
    imports = (f"try: import {name}\nexcept ImportError: traceback.print_exc()\n" for name in unanswered)
    done = ask(f"{INSTALL}import traceback\n{''.join(imports)}", str(tmp_path))
    _, *errors = done.stderr.split("Traceback")
    for name, error in zip(unanswered, errors, strict=True):
        assert f"ModuleNotFoundError: there is no {name} in this simulation" in error
        assert "cliport.tasks.task" in error and "transforms3d.euler" in error


def test_published_tasks_may_be_imported_and_are_refused_by_name_when_they_run() -> None:
    done = ask(
        INSTALL
        + """
import pybullet_utils
from cliport.environments.environment import Environment
from cliport.tasks.put_block_in_bowl import PutBlockInBowlSeenColors
from cliport.tasks.task import Task
class Mine(PutBlockInBowlSeenColors): pass
assert issubclass(Mine, Task)
env = Environment(task=Mine())
assert env.get_task_name() == "Mine"
env.reset()
"""
    )
    assert "UnsupportedError: Mine is a task of cliport.tasks.put_block_in_bowl, whose" in done.stderr
    done = ask(INSTALL + "from cliport.tasks.put_block_in_bowl import TEMPLATES")
    assert "ImportError" in done.stderr


def test_a_filled_template_is_removed_without_a_file_and_nothing_else_is_spared(tmp_path) -> None:
    (tmp_path / "mine.txt").write_text("")
    done = ask(
        INSTALL
        + f"""
import os
from grs_agents.sim import Task
name = Task().fill_template("box/box-template.urdf", {{"DIM": (0.1, 0.1, 0.1)}})
os.remove(name)
os.remove({str(tmp_path / "mine.txt")!r})
try:
    os.remove(name + "x")
except FileNotFoundError:
    print("refused")
"""
    )
    assert done.stdout.strip() == "refused", done.stderr
    assert not (tmp_path / "mine.txt").exists()


def test_what_programs_of_lohoravens_take_for_granted_is_there() -> None:
    done = ask(
        INSTALL
        + """
import random
import numpy as np
import pybullet as p
from cliport.environments.environment import Environment
from cliport.tasks.color_reasoning import COLOR_CATEGORY_NAMES
from cliport.tasks.task import Task
from cliport.utils import utils

class WarmBlocksToTheLeft(Task):
    def __init__(self):
        super().__init__()
        self.lang_template = "Move the warm blocks to the {}."

    def reset(self, env):
        super().reset(env)
        self.consider_z_in_match = False
        colors = random.sample(set(utils.TRAIN_COLORS + utils.EVAL_COLORS), 4)
        warm = [color for color in colors if color in COLOR_CATEGORY_NAMES["WARM"]]
        area, blocks = self.area_boundary["top left area"], []
        zone = ((area["x_start"] + self.x_length / 4, area["y_start"] + self.y_length / 4, 0), (0, 0, 0, 1))
        for color in colors:
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            block = env.add_object("stacking/block.urdf", pose)
            p.changeVisualShape(block, -1, rgbaColor=utils.COLORS[color] + [1])
            blocks.append((block, (np.pi / 2, None)))
        moved = [block for block, color in zip(blocks, colors) if color in warm]
        points = {block: self.get_box_object_points(block) for block, _ in moved}
        size = (self.x_length / 2, self.y_length / 2, 0)
        params = (points, [(zone, size)])
        self.goals.append((moved, np.ones((len(moved), 1)), [zone], True, False, "zone_with_z_match", params, 1))
        self.goals.append(([], np.ones((0, 0)), [], False, True, "pose", None, 1))
        self.lang_goals += [self.lang_template.format("left")] * 2

random.seed(0)
task = WarmBlocksToTheLeft()
env = Environment(task=task, seed=0)
env.reset()
assert len(task.goals) == 1 and task.goals[0].objects, task.goals
print(env.current_episode.warnings)
"""
    )
    assert done.returncode == 0, done.stderr
    assert "a goal of task.goals names no object" in done.stdout
