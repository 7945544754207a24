"""The scripts of `grs_agents.examples`: what they name is there, and the one that needs numpy alone learns."""

import ast
import contextlib
import importlib
import importlib.util
import inspect
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import Pose
from grs_agents.envs import GrsEnv, make_env
from grs_agents.sim import Goal, InstanceObject, TaskInstance
from grs_agents.tasks.demos.dataset import write_dataset
from grs_agents.tasks.demos.production import DemoOrder, make_demonstrations
from grs_agents.tasks.task_folder import open_task_folder
from tests.cli.command import grs
from tests.needs import needs

ROOT = Path(__file__).parent.parent.parent
SCRIPTS = sorted((ROOT / "grs_agents" / "examples").glob("[!_]*.py"))
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def imported_names(tree: ast.Module) -> list[tuple[str, str]]:
    """Module and name of each ``from module import name``, of modules that are installed."""
    found = [node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module]
    here = [node for node in found if importlib.util.find_spec(str(node.module).partition(".")[0])]
    if importlib.util.find_spec("torch") is None:
        here = [node for node in here if node.module != "grs_agents.examples._learning"]  # which needs it
    return [(str(node.module), alias.name) for node in here for alias in node.names]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_names_what_there_is(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    tree = ast.parse(text)
    for module, name in imported_names(tree):
        assert hasattr(importlib.import_module(module), name), f"{module}.{name}"
    known = set(inspect.signature(GrsEnv).parameters) | {"n_envs", "use_async_envs", "cfg"}
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if ast.unparse(call.func) in ("gymnasium.make", "make_env"):
            assert {keyword.arg for keyword in call.keywords} <= known


def test_the_page_and_the_scripts_name_one_another() -> None:
    page = (ROOT / "docs" / "use_your_task.md").read_text(encoding="utf-8")
    assert SCRIPTS and all(f"python -m grs_agents.examples.{script.stem} runs/" in page for script in SCRIPTS)


def write_block_task(folder: Path) -> None:
    """A block that is to stand at the left; the target moves with the block's own variations."""
    target: Pose = ((0.5, 0.15, 0.02), UPRIGHT)
    goal = Goal(
        objects=(1,),
        matches=((1,),),
        targets=(target,),
        replace=False,
        rotations=False,
        metric="pose",
        max_reward=1.0,
        symmetries=(0.0,),
        language="put the block at the left",
    )
    block = InstanceObject(id=1, asset="block/block.urdf", pose=((0.5, -0.1, 0.02), UPRIGHT))
    task = TaskInstance(task="PutBlockLeft", seed=0, max_steps=2, timestep=0.004, objects=(block,), goals=(goal,))
    (folder / "instances").mkdir(parents=True)
    (folder / "instances" / "seed_0.json").write_text(task.model_dump_json(), encoding="utf-8")


def test_the_files_of_the_page_on_variations_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "variations.md").read_text(encoding="utf-8")
    for name, text in re.findall(r"^```python\n# (\w+\.py)\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
        (tmp_path / name).write_text(text, encoding="utf-8")
    run = tmp_path / "runs" / "boxes"
    write_block_task(run)
    assert grs("instances", str(run), "--seeds", "0:9", "--jitter", "0.03", folder=tmp_path).returncode == 0
    with contextlib.chdir(tmp_path):
        made = runpy.run_path("vary.py")
        runpy.run_path("learn.py")
    assert made["varied"].objects[0].pose != made["instance"].objects[0].pose
    assert capsys.readouterr().out.splitlines()[-1] == "True"


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task beside its data set with pictures."""
    folder = tmp_path_factory.mktemp("runs")
    write_block_task(folder / "block")
    task = open_task_folder(folder / "block")
    order = DemoOrder(episodes=1, replays=1, control="ee_delta", cameras=("front", "wrist"), size=(96, 96))
    made = make_demonstrations(task, order, folder / "work", lambda _: None)
    write_dataset(made, "lerobot", folder / "block-demos", task)
    return folder / "block"


def run_closed_loop(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    """Train briefly, and judge one episode."""
    monkeypatch.setattr("sys.argv", ["", *arguments, "--steps", "20", "--looks", "5", "--episodes", "1"])
    runpy.run_module("grs_agents.examples.closed_loop", run_name="__main__")


@needs("torch", "pyarrow", "av")
@pytest.mark.parametrize("camera", [(), ("--camera", "front")], ids=["state", "front"])
def test_closed_loop_trains_on_a_data_set_and_acts_in_its_environment(
    demonstrated: Path, camera: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_closed_loop(monkeypatch, str(demonstrated), *camera)
    assert re.match(r"solved [01] of 1 \(\d+% to \d+%\), \d+\.\d CPU minutes in all\n", capsys.readouterr().out)


@needs("torch", "pyarrow", "av")
def test_closed_loop_refuses_a_camera_that_moves(demonstrated: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SystemExit, match="no pictures of wrist, or it moves; there are front"):
        run_closed_loop(monkeypatch, str(demonstrated), "--camera", "wrist")


@needs("torch", "pyarrow", "av")
def test_the_eye_finds_what_it_has_seen(demonstrated: Path) -> None:
    learning, torch = importlib.import_module("grs_agents.examples._learning"), importlib.import_module("torch")
    torch.manual_seed(0)
    eye = learning.open_eye(f"{demonstrated}-demos", "front", 80)
    env = make_env(str(demonstrated), control="ee_delta", cameras=("front",), image_size=(96, 96)).popitem()[1][0]
    now, _ = env.reset(seed=0)
    env.close()
    np.testing.assert_allclose(eye.look(now)[0, :2], now["environment_state"][0, :2], atol=0.01)


def test_behaviour_cloning_learns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_block_task(tmp_path)
    monkeypatch.setattr("sys.argv", ["", str(tmp_path), "--demonstrations", "8", "--episodes", "4"])
    runpy.run_module("grs_agents.examples.behaviour_cloning", run_name="__main__")
    told = capsys.readouterr().out
    assert "8 demonstrations" in told
    assert "solved of 4: 4 by the policy, 0 by random decisions" in told
