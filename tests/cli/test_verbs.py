"""The verbs that look: each works from the command line and says what it promises."""

import json
import shutil
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import pytest

from grs_agents.base import content
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy
from grs_agents.runs.record import RunRecord
from grs_agents.sim import find_task_class, instantiate
from tests.cli.command import Done, grs

PROGRAM = '''
import numpy as np

from grs_agents.sim import Task


class PlaceBlock(Task):
    """Put the red block into the zone."""

    def __init__(self):
        super().__init__()
        self.max_steps = 4
        self.lang_template = "put the red block into the zone"
        self.task_completed_desc = "done."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        zone_size = (0.15, 0.15, 0.01)
        zone_pose = self.get_random_pose(env, zone_size)
        env.add_object("zone/zone.urdf", zone_pose, "fixed")
        block_size = (0.04, 0.04, 0.04)
        blocks = [env.add_object("block/red_block.urdf", self.get_random_pose(env, block_size)) for _ in range(2)]
        self.add_goal(
            objs=blocks,
            matches=np.ones((2, 1)),
            targ_poses=[zone_pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(zone_pose, zone_size)],
            step_max_reward=1,
            language_goal=self.lang_template,
        )
'''
TESTS = """
import unittest

import numpy as np
from {name} import PlaceBlock
from grs_agents.sim import Environment, utils


class TestPlaceBlock(unittest.TestCase):
    def test_oracle(self):
        env = Environment(None)
        task = PlaceBlock()
        env.set_task(task)
        obs = env.reset()
        blocks = env.find("{block}")
        self.assertEqual(len(blocks), 2)
        start = [env.get_object_pose(block)[0] for block in blocks]
        agent = task.oracle(env)
        total = 0
        for _ in range(task.max_steps):
            act = agent.act(obs, env.info)
            if act is None:
                break
            obs, reward, done, info = env.step(act)
            total += reward
            if done:
                break
        self.assertGreater(total, {bound})
        (x, y, _), turn = env.get_object_pose(env.find("zone/zone.urdf")[0])
        yaw = utils.quatXYZW_to_eulerXYZ(turn)[2]
        for block, began in zip(blocks, start):
            end = env.get_object_pose(block)[0]
            self.assertGreater(np.linalg.norm(np.subtract(end, began)), 0.05)
            dx, dy = end[0] - x, end[1] - y
            self.assertLess(abs(np.cos(yaw) * dx + np.sin(yaw) * dy), 0.06)
            self.assertLess(abs(np.cos(yaw) * dy - np.sin(yaw) * dx), 0.06)
"""
RED = "block/red_block.urdf"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    file = tmp_path / "place_block.py"
    file.write_text(PROGRAM)
    return file


@pytest.mark.parametrize("name", ["task_code", "place_block"])
def test_check_accepts_a_program_of_ones_own(tmp_path: Path, program: Path, name: str) -> None:
    (tmp_path / "tests.py").write_text(TESTS.format(name=name, bound=0.99, block=RED))
    done = grs("check", str(program), "--tests", "tests.py", "--json", folder=tmp_path)
    found = json.loads(done.stdout)
    assert (done.returncode, found["status"]) == (0, "accepted"), done.stdout
    assert len(found["audit"]["rollouts"]) == 3


def test_check_rejects_a_program_whose_tests_fail(tmp_path: Path, program: Path) -> None:
    (tmp_path / "tests.py").write_text(TESTS.format(name="task_code", bound=2, block=RED))
    done = grs("check", str(program), "--tests", "tests.py", "--seeds", "1", folder=tmp_path)
    assert done.returncode == 1
    assert "rejected" in done.stdout and "test_oracle" in done.stdout


@pytest.mark.parametrize(
    "source",
    [
        "def broken(:",
        "while True: pass\n" + PROGRAM,
        "import os; os._exit(0)\n" + PROGRAM,
        "x = 1",
        PROGRAM.replace("super().reset(env)", "raise RuntimeError"),
        PROGRAM.replace('"block/red_block.urdf"', '"block/red_blok.urdf"'),
    ],
    ids=["syntax", "endless", "exit", "no task", "raises", "no asset"],
)
def test_check_rejects_what_gives_no_instance(tmp_path: Path, source: str) -> None:
    (tmp_path / "bad.py").write_text(source)
    done = grs("check", "bad.py", "--set", "limits.wall_seconds=2", "--json", folder=tmp_path)
    assert done.returncode == 1, done.stderr
    findings = {item["check"]: item["passed"] for item in json.loads(done.stdout)["audit"]["findings"]}
    assert findings["instantiated"] is False and findings["solved"] is False


FORGER = """
import json
from grs_agents.sandbox.harness.channel import report_progress
for seed in range(3):
    text = json.dumps({{**{instance!r}, "seed": seed}})
    report_progress({{"item": str(seed), "phase": "start"}})
    report_progress({{"item": str(seed), "phase": "end", "instance": text}})
"""


def test_check_rejects_a_program_without_a_task_that_writes_instances_itself(tmp_path: Path, program: Path) -> None:
    module = ModuleType("task_code")
    exec(program.read_text(), module.__dict__)
    instance = instantiate(find_task_class(module)(), 0).model_dump(mode="json")
    (tmp_path / "forger.py").write_text(FORGER.format(instance=instance))
    done = grs("check", "forger.py", "--json", folder=tmp_path)
    found = json.loads(done.stdout)
    assert (done.returncode, found["status"]) == (1, "rejected")
    assert "class Name(Task)" in found["audit"]["findings"][0]["measured"]


def test_check_says_that_the_verdict_is_about_the_instances(tmp_path: Path, program: Path) -> None:
    done = grs("check", str(program), "--seeds", "1", folder=tmp_path)
    assert "is about the task instances" in " ".join(done.stdout.split())


def test_check_takes_the_seeds_of_the_configuration(tmp_path: Path, program: Path) -> None:
    done = grs("check", str(program), "--set", "audit.seeds=1", "--json", folder=tmp_path)
    assert len(json.loads(done.stdout)["audit"]["rollouts"]) == 1


@pytest.mark.parametrize("source", ["raise RuntimeError('on purpose')", "def build():\n    1 / 0"])
def test_a_graph_of_the_users_own_that_fails_is_one_line_with_its_file(tmp_path: Path, source: str) -> None:
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "bad.py").write_text(source)
    done = grs("--content", str(tmp_path), "graph", "bad", folder=tmp_path)
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert line.startswith("grs: graph 'bad' cannot be ") and f"bad.py:{len(source.splitlines())}: " in line


def test_what_nobody_caught_is_our_error(tmp_path: Path) -> None:
    with patch("grs_agents.cli.listing.list_content", side_effect=RuntimeError("on purpose")):
        done = grs("list", folder=tmp_path)
    assert done.returncode == 3
    lines = done.stderr.splitlines()
    assert lines[0].startswith("grs: RuntimeError: on purpose") and lines[1].startswith("Traceback")


def test_check_says_what_was_assumed(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM.replace("zone/zone.urdf", "zone/zone-template.urdf"))
    done = grs("check", "program.py", "--seeds", "1", "--json", folder=tmp_path)
    (rollout,) = json.loads(done.stdout)["audit"]["rollouts"]
    assert any("takes its defaults" in warning for warning in rollout["warnings"])
    assert "warning" in grs("check", "program.py", "--seeds", "1", folder=tmp_path).stdout


def test_check_knows_the_assets_of_a_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    name = write_proxy(
        run / "assets",
        "crate_1",
        primitive_proxy("box", (0.05, 0.05, 0.05), (0.8, 0.1, 0.1)),
        "a crate",
    ).name
    RunRecord(
        id="run",
        status="accepted",
        command="run",
        source="a",
        graph="grs",
        versions={},
        seeds=(5,),
        config=RecordedConfig.of(Config(seed=5)),
    ).write(run)
    (run / "simulation.py").write_text(PROGRAM.replace("block/red_block.urdf", name))
    (run / "test_simulation.py").write_text(TESTS.format(name="task_code", bound=0.99, block=name))
    (tmp_path / "mine.py").write_text((run / "simulation.py").read_text())
    whole = grs("check", "run", "--seeds", "1", "--json", folder=tmp_path)
    assert whole.returncode == 0, whole.stdout
    found = json.loads(whole.stdout)
    assert found["tests"]["outcome"] == "passed" and found["audit"]["rollouts"][0]["seed"] == 5
    assert grs("check", "mine.py", "--seeds", "1", "--scene", "run", folder=tmp_path).returncode == 0
    alone = grs("check", "mine.py", "--seeds", "1", folder=tmp_path)
    assert alone.returncode == 1 and "crate_1" in alone.stdout
    assert grs("check", "mine.py", "--scene", ".", folder=tmp_path).returncode == 2


def test_a_policy_lies_in_the_current_folder(tmp_path: Path, program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    (tmp_path / "policy_of_mine.py").write_text("class Mine:\n    def decide(self, context): ...\n")
    options = ["--seeds", "1", "--set", "policy=policy_of_mine:Mine"]
    assert grs("check", str(program), *options, folder=tmp_path).returncode == 0


LONG = "a folder of runs whose name is long/and another in it whose name is long as well/run"


@pytest.fixture(scope="module")
def groceries(tmp_path_factory: pytest.TempPathFactory, sample_run: Path) -> tuple[Done, Path]:
    """The sample scene, taken over where a terminal has 80 columns, into a folder whose path is longer than a line."""
    folder = tmp_path_factory.mktemp("groceries")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        done = grs("scene", str(sample_run), "--out", LONG, folder=folder)
    assert done.returncode == 0, done.stderr
    return done, folder / LONG


def test_a_sample_scene_is_found_by_its_name(tmp_path: Path, sample_run: Path) -> None:
    assert "groceries" in json.loads(grs("list", "--json", folder=tmp_path).stdout)["scenes"]
    assert json.loads((sample_run / "run.json").read_text())["counts"]["candidates"] > 5
    (tmp_path / "groceries").mkdir()
    own = grs("scene", "groceries", folder=tmp_path)
    assert own.returncode == 2 and "groceries/rgb.png" in own.stderr
    assert "groceries" in grs("scene", "grocery", folder=tmp_path).stderr


def test_an_experiment_shows_its_own_options(tmp_path: Path) -> None:
    done = grs("eval", "perception", "--help", folder=tmp_path)
    assert done.returncode == 0 and "usage: grs eval perception" in done.stdout and "--workers" in done.stdout
    assert "eval [OPTIONS]" in grs("eval", "--help", folder=tmp_path).stdout


def test_check_wants_a_file(tmp_path: Path) -> None:
    done = grs("check", "nowhere.py", folder=tmp_path)
    assert done.returncode == 2
    assert "nowhere.py" in done.stderr


@pytest.mark.parametrize("name", content.content_names("graphs"))
def test_graph_draws_every_graph(tmp_path: Path, name: str) -> None:
    done = grs("graph", name, folder=tmp_path)
    assert "graph TD" in done.stdout


def test_an_unknown_graph_lists_the_graphs(tmp_path: Path) -> None:
    done = grs("graph", "router2", folder=tmp_path)
    assert done.returncode == 2
    assert "router" in done.stderr and "no_fix" in done.stderr


def test_list_names_all_content(tmp_path: Path) -> None:
    found = json.loads(grs("list", "--json", folder=tmp_path).stdout)
    assert set(found) == {"graphs", "tools", "prompts", "evals", "assets", "scenes", "cassettes", "policies", "models"}
    assert [kind for kind, things in found.items() if not things] == []
    texts = [text for things in found.values() for text in things.values()]
    assert all(texts) and not [text for text in texts if "`" in text or text.startswith(("---", "#"))]
    assert found["prompts"]["route"].startswith("You keep two programs in step")


def test_config_says_where_each_value_came_from(tmp_path: Path) -> None:
    (tmp_path / "grs.toml").write_text("max_fixes = 3\n")
    options = ["--config", "grs.toml", "--set", "policy=rules", "--json"]
    found = json.loads(grs("config", *options, folder=tmp_path).stdout)
    assert found["max_fixes"] == {"value": 3, "source": "file grs.toml"}
    assert found["policy"] == {"value": "rules", "source": "--set"}
    assert found["seed"] == {"value": 0, "source": "default"}


def test_doctor_finds_a_working_sandbox_and_tells_a_missing_key_from_a_missing_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("langchain_openai")
    monkeypatch.setitem(sys.modules, "langchain_anthropic", None)
    monkeypatch.setenv("ANTHROPIC_API_KEY", "x")
    done = grs("doctor", "--json", folder=tmp_path)
    found = {one["subject"]: one for one in json.loads(done.stdout)}
    assert done.returncode == 0 and found["sandbox"]["state"] == "works"
    openai, anthropic = found["models openai"], found["models anthropic"]
    assert openai["state"] == "no key" and openai["remedy"] == "export OPENAI_API_KEY=..."
    assert anthropic["state"] == "not installed" and 'pip install "grs-agents[anthropic]"' in anthropic["remedy"]
    assert "ANTHROPIC_API_KEY is set" in anthropic["detail"]
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))["project"]
    extras = {subject.removeprefix("extra ") for subject in found if subject.startswith("extra ")}
    assert extras == set(project["optional-dependencies"])
    assert all(one["remedy"] for one in found.values() if one["state"] in ("absent", "not installed", "no key"))


def test_doctor_tells_each_remedy_once_and_on_a_whole_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr("grs_agents.cli.doctor.GL_BACKENDS", {})
    monkeypatch.setattr("grs_agents.cli.doctor._diagnose_sandboxes", list)  # attacks take seconds
    monkeypatch.setitem(sys.modules, "langchain_anthropic", None)
    lines = [line.strip() for line in grs("doctor", folder=tmp_path).stdout.splitlines()]
    remedies = lines[lines.index("how to get the rest") + 1 :]
    assert remedies.count('pip install "grs-agents[anthropic]"') == 1
    assert "export AZURE_OPENAI_API_KEY=..." in remedies


@pytest.mark.parametrize("verb", ["assets", "scene"])
def test_names_stay_whole_in_a_terminal_of_80_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str, groceries: tuple[Done, Path]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    done = groceries[0] if verb == "scene" else grs("assets", "list", folder=tmp_path)
    lines = [line for line in done.stdout.splitlines() if LONG not in line]
    assert max(map(len, lines)) <= 80
    names = [word for line in lines for word in line.split() if "/" in word and "." in word]
    assert len(names) >= 8 and all(name.endswith(".urdf") for name in names if not name.startswith(("runs/", "(")))


def test_a_low_coverage_is_the_first_line_of_the_result(tmp_path: Path, groceries: tuple[Done, Path]) -> None:
    assert not groceries[0].stdout.startswith("coverage")
    folder = tmp_path / "low"
    shutil.copytree(groceries[1], folder)
    scene = json.loads((folder / "scene.json").read_text())
    scene["coverage"] |= {"share": 0.5, "unowned": []}
    scene["warnings"] = ["coverage 0.50", *scene["warnings"]]
    (folder / "scene.json").write_text(json.dumps(scene))
    done = grs("scene", str(folder), "--out", "again", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "coverage 0.50"


def test_a_command_or_path_that_is_printed_is_not_broken_where_the_terminal_ends(groceries: tuple[Done, Path]) -> None:
    coverage, command = groceries[0].stdout.splitlines()[-2:]
    assert f"({LONG}/scene/coverage.png)" in coverage
    assert command.startswith("grs replay ") and LONG in command


def test_check_tells_tests_by_name_in_80_columns(
    tmp_path: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    name = "test_that_the_oracle_puts_every_block_there"
    tests = TESTS.format(name="task_code", bound=0.99, block=RED).replace("TestPlaceBlock", "TestOfAClassWithALongName")
    (tmp_path / "tests.py").write_text(tests.replace("test_oracle", name))
    done = grs("check", str(program), "--tests", "tests.py", "--seeds", "1", folder=tmp_path)
    assert name in done.stdout and "…" not in done.stdout


def test_scene_comprehends_alone_and_ends_with_its_objects(
    tmp_path: Path, small_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    done = grs("scene", str(small_scene), "--out", "run", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    objects = json.loads((tmp_path / "run" / "scene.json").read_text())["objects"]
    assert len(objects) == 3
    assert not (tmp_path / "run" / "simulation.py").exists()
    assert all(one["name"] in done.stdout and one["asset"] in done.stdout for one in objects)
    assert "code_fixes" not in done.stdout


def test_show_refuses_a_folder_without_a_run(tmp_path: Path) -> None:
    done = grs("show", ".", folder=tmp_path)
    assert done.returncode == 2
    assert "holds no run" in done.stderr
