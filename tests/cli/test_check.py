"""``grs check --task --scene``: a program of one's own is checked as a run checks its own."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.errors import InputError
from grs_agents.runs.hashes import write_hashes
from grs_agents.sim.rollouts import rollout
from grs_agents.tasks.task_folder import open_task_folder
from tests.cli.command import grs
from tests.gantry import GANTRY

SEEDS = ("--set", "audit.seeds=1", "--json")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, accepted_run: Path) -> Path:
    """A copy of an accepted run, beside which files may lie."""
    return Path(shutil.copytree(accepted_run, tmp_path_factory.mktemp("checked") / "run"))


def findings_of_run(run: Path) -> list[dict[str, Any]]:
    """What its own audit found."""
    return json.loads((run / "audit.json").read_text("utf-8"))["findings"]


def check(run: Path, *arguments: str) -> dict[str, Any]:
    """What ``grs check`` says of its program, which was copied out of the run."""
    (run.parent / "task_code.py").write_text((run / "simulation.py").read_text("utf-8"), "utf-8")
    done = grs("check", "task_code.py", "--tests", "run/test_simulation.py", *arguments, *SEEDS, folder=run.parent)
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("how", ["run", "run/scene.json", "photo"])
def test_a_program_is_checked_as_in_a_run(run: Path, small_scene: Path, how: str) -> None:
    scene = str(small_scene) if how == "photo" else how
    found = check(run, "--task", "run/task.json", "--scene", scene)
    assert found["audit"]["findings"] == findings_of_run(run)
    assert found["status"] == "accepted"


def test_a_run_is_checked_against_its_own_task_and_scene(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "kept"
    done = grs("check", "run", *SEEDS, "--out", str(out), folder=run.parent)
    assert json.loads(done.stdout)["audit"]["findings"] == findings_of_run(run)
    kept = open_task_folder(out)
    assert kept.read_instance(0) == open_task_folder(run).read_instance(0)
    assert rollout(kept.read_instance(0), kept.library).episode.outcome == "success"
    for name in ("task.json", "simulation.py", "test_simulation.py"):
        assert (out / name).read_text("utf-8") == (run / name).read_text("utf-8")
    again = grs("check", "run", *SEEDS, "--out", str(out), folder=run.parent)
    assert again.returncode == 2 and "not empty" in again.stderr


def test_a_rejected_task_is_not_kept(run: Path, tmp_path: Path) -> None:
    out, task = tmp_path / "kept", tmp_path / "task.json"
    written = json.loads((run / "task.json").read_text("utf-8"))
    task.write_text(json.dumps({**written, "task-description": "Make it nice with the robot arm."}))
    done = grs(
        "check", "run", *SEEDS, "--set", "audit.words=agree", "--task", str(task), "--out", str(out), folder=run.parent
    )
    assert done.returncode == 1 and not out.exists()


def test_a_task_in_words_that_nobody_understands_is_accepted_for_its_sentence(run: Path, tmp_path: Path) -> None:
    """The sentence stands wherever the task is stated; the author's words are a paraphrase beside it."""
    record, task = (json.loads((run / name).read_text("utf-8")) for name in ("run.json", "task.json"))
    sentence = record["sentence"]
    assert sentence == task["sentence"] == task["instructions"]["specific"]["text"]
    assert task["instructions"]["default"] == {**record["words"], "text": task["task-description"]}
    assert task["instructions"]["vague"]["text"] and task["instructions"]["vague"]["by"] == "goals"
    assert json.loads((run / "instances/seed_0.json").read_text("utf-8"))["instruction"] == sentence
    (tmp_path / "task.json").write_text(json.dumps({**task, "task-description": "Make it nice with the robot arm."}))
    told = ("--task", str(tmp_path / "task.json"), "--scene", "run/scene.json")
    found = check(run, *told)
    assert (found["status"], found["sentence"]) == ("accepted", sentence)
    assert found["words"]["verdict"] == "not_judged" and found["words"]["by"] == "offline"
    strict = check(run, *told, "--set", "audit.words=agree")
    assert strict["status"] == "rejected" and strict["reason"].startswith("words: ")
    plain = grs("check", "run", *told, *SEEDS[:-1], folder=run.parent).stdout
    assert f"sentence: {sentence}" in " ".join(plain.split()) and "not_judged, says offline: not understood" in plain


def test_another_task_is_not_what_the_program_does(run: Path, tmp_path: Path) -> None:
    task = json.loads((run / "task.json").read_text("utf-8"))
    (tmp_path / "task.json").write_text(json.dumps({**task, "assets-used": ["bowl/bowl.urdf"]}))
    found = check(run, "--task", str(tmp_path / "task.json"))
    failed = [finding for finding in found["audit"]["findings"] if not finding["passed"]]
    assert found["status"] == "rejected" and "bowl/bowl.urdf" in str(failed)


def test_a_revised_task_is_held_against_the_one_before(run: Path, tmp_path: Path) -> None:
    task = json.loads((run / "task.json").read_text("utf-8"))
    before = {**task, "assets-used": [f"mug/mug_{number}.urdf" for number in range(8)]}
    (tmp_path / "task.json").write_text(json.dumps({**task, "revised": {"from": before, "given-up": "most"}}))
    found = check(run, "--task", str(tmp_path / "task.json"))
    assert "mug/mug_7.urdf" in str([finding for finding in found["audit"]["findings"] if not finding["passed"]])


@pytest.mark.parametrize(
    ("option", "name", "content", "said"),
    [
        ("--task", "nowhere.json", None, "nowhere.json"),
        ("--task", "task.json", "{", "not JSON"),
        ("--task", "task.json", "{}", "task-name"),
        ("--task", "task.json", '{"revised": {"given-up": "all"}}', "revised"),
        ("--scene", "nowhere.json", None, "nowhere.json"),
        ("--scene", "scene.json", "{}", "scene.json"),
        ("--scene", "nowhere", None, "nowhere"),
    ],
)
def test_what_is_no_task_or_scene_is_refused_in_one_line(
    run: Path, tmp_path: Path, option: str, name: str, content: str | None, said: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    done = grs("check", str(run / "simulation.py"), option, name, folder=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done
    assert said in done.stderr


def test_where_no_model_is_asked_none_is_loaded() -> None:
    look = "import sys, grs_agents.cli.check; print({name.partition('_')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True).stdout
    assert "'grs'" in loaded and "'langchain'" not in loaded and "'langgraph'" not in loaded


@pytest.mark.parametrize("verb", ["check", "verify"])
def test_the_arm_of_a_run_folder_is_compiled_in_a_worker_first(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    class Reader:
        def __init__(self, *_: Any, **__: Any) -> None: ...

        def __enter__(self) -> "Reader":
            return self

        def __exit__(self, *_: object) -> None: ...

        def read(self, request: dict[str, Any], name: str) -> None:
            raise InputError(f"a worker reads {request['robot']}")

    copy = Path(shutil.copytree(run, tmp_path / "run"))
    record = json.loads((copy / "run.json").read_text("utf-8"))
    record["config"]["robot"] = "/elsewhere/arm.xml"
    (copy / "run.json").write_text(json.dumps(record), "utf-8")
    (copy / "robot").mkdir()
    (copy / "robot" / "arm.xml").write_text(GANTRY)
    write_hashes(copy)
    monkeypatch.setattr("grs_agents.sim.arms.arm_files.ForeignReader", Reader)
    done = grs(verb, "run", folder=tmp_path)
    assert done.returncode == 2, done
    assert f"a worker reads {copy.resolve() / 'robot' / 'arm.xml'}" in done.stderr
