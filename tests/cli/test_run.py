"""``grs run`` from the command line to the verdict."""

import contextlib
import json
import shlex
import shutil
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import ormsgpack
import pytest

from grs_agents.base.trace.events import Reply
from grs_agents.base.trace.log import read_events
from tests.cli.command import grs
from tests.slow import SLOW, slow_where

FILES = (
    "run.json",
    "scene.json",
    "task.json",
    "simulation.py",
    "test_simulation.py",
    "audit.json",
    "events.jsonl",
    "trace.rrd",
    "checkpoint.sqlite",
)


@pytest.fixture(scope="module")
def accepted(tmp_path_factory: pytest.TempPathFactory, sample_run: Path) -> tuple[Path, dict[str, Any]]:
    """One run of the sample scene, and what it printed."""
    folder = shutil.copytree(sample_run, tmp_path_factory.mktemp("accepted") / "run")
    return Path(folder), json.loads((sample_run.parent / "printed.json").read_text())


def test_the_sample_scene_is_accepted(accepted: tuple[Path, dict[str, Any]]) -> None:
    folder, record = accepted
    assert record["status"] == "accepted"
    assert record["exit_status"] == 0
    assert len(record["rewards"]) == 3 and min(record["rewards"]) >= 0.99
    assert record == json.loads((folder / "run.json").read_text())


def test_everything_is_in_the_run_folder(accepted: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = accepted
    assert [name for name in FILES if not (folder / name).is_file()] == []
    assert len(json.loads((folder / "scene.json").read_text())["objects"]) >= 8
    assert len(list((folder / "instances").glob("*.json"))) == 3
    assert (folder / "history" / "simulation_001.py").is_file()
    assert (folder / "history" / "test_simulation_001.diff").is_file()


def test_a_task_instance_has_the_camera_of_the_photo(accepted: tuple[Path, dict[str, Any]], sample_scene: Path) -> None:
    folder, _ = accepted
    given = json.loads((sample_scene / "camera.json").read_text())
    camera = json.loads((folder / "instances" / "seed_0.json").read_text())["camera"]
    assert {name: camera[name] for name in ("fx", "fy", "cx", "cy")} == {
        name: given[name] for name in ("fx", "fy", "cx", "cy")
    }
    assert camera["pose"][0] == pytest.approx([row[3] for row in given["T_robot_cam"]][:3], abs=0.02)
    assert not camera["robot_placed"]


def test_the_log_tells_every_step(accepted: tuple[Path, dict[str, Any]]) -> None:
    folder, record = accepted
    events = read_events(folder / "events.jsonl")
    nodes = [event.node for event in events if event.kind == "node_ended"]
    assert nodes[:4] == ["read", "find_table", "segment", "describe"]
    assert nodes.index("settle") + 1 == nodes.index("generate_task")
    assert nodes[-2:] == ["audit", "conclude"]
    assert sum(event.kind == "prompt" for event in events) == record["counts"]["model_calls"]
    assert sum(event.kind == "rollout" for event in events) >= 3


def test_no_key_and_no_home_is_written(accepted: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = accepted
    assert "API_KEY" not in (folder / "events.jsonl").read_text()


def test_an_ended_run_is_resumed_without_work(accepted: tuple[Path, dict[str, Any]], sample_scene: Path) -> None:
    folder, record = accepted
    before = (folder / "events.jsonl").read_bytes()
    for scene in ([str(sample_scene)], []):  # it knows its scene
        done = grs("run", *scene, "--out", str(folder), "--resume", "--json", folder=folder.parent)
        assert json.loads(done.stdout) == record, done.stderr
    assert (folder / "events.jsonl").read_bytes() == before


def test_a_run_ends_with_its_task_in_words_and_says_that_the_offline_model_costs_nothing(
    accepted: tuple[Path, dict[str, Any]],
) -> None:
    folder, record = accepted
    done = grs("run", "--out", str(folder), "--resume", folder=folder.parent)
    words = json.loads((folder / "task.json").read_text())["task-description"]
    assert done.stdout.splitlines()[0].endswith(words)
    assert record["cost"] == 0 and "they cost nothing" in done.stdout


def test_the_scene_of_a_run_is_taken_over(tmp_path: Path, known_scene: Path) -> None:
    """Nothing is perceived again; another arm would have placed and tried things otherwise."""
    done = grs("run", str(known_scene), "--out", "run", "--seed", "5", "--json", folder=tmp_path)
    assert json.loads(done.stdout)["status"] == "accepted", done.stderr
    events = read_events(tmp_path / "run" / "events.jsonl")
    assert [event.node for event in events if event.kind == "node_ended"][:2] == ["read", "generate_task"]
    assert {event.role for event in events if event.kind == "prompt"} == {"task", "simulation", "tests", "judge"}
    assert [event.stage for event in events if event.kind == "scene_stage"][-1] == "matched"
    made, taken = (json.loads((folder / "scene.json").read_text()) for folder in (known_scene, tmp_path / "run"))
    assert made == taken
    assert grs("verify", "run", folder=tmp_path).returncode == 0
    refused = grs("run", str(known_scene), "--out", "other", "--set", "robot=panda", folder=tmp_path)
    assert refused.returncode == 2 and "robot=ur5e, not panda" in refused.stderr


def test_show_lists_the_steps(accepted: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = accepted
    done = grs("show", str(folder), folder=folder.parent)
    assert done.returncode == 0
    assert "generate_sim" in done.stdout and "audit" in done.stdout


def test_a_terminated_run_says_so_and_a_tampered_checkpoint_runs_nothing(tmp_path: Path, known_scene: Path) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-m", "grs_agents", "run", str(known_scene), "--out", str(out), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while process.poll() is None and '"node":"run_tests"' not in _text(out / "events.jsonl"):
            time.sleep(0.01)
        process.terminate()
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.wait()
    record = json.loads((out / "run.json").read_text())
    assert record["status"] == "interrupted"
    assert record["counts"]["objects"] == 3
    call = ormsgpack.packb(("subprocess", "getoutput", f"touch {tmp_path / 'owned'}"))
    with contextlib.closing(sqlite3.connect(out / "checkpoint.sqlite")) as connection:
        payload = ormsgpack.packb(ormsgpack.Ext(0, call))
        connection.execute("update writes set type = 'msgpack', value = ?", (payload,))
        connection.execute("delete from checkpoints where checkpoint_id = (select max(checkpoint_id) from checkpoints)")
        connection.commit()
    grs(*command[3:], "--resume", folder=tmp_path)
    assert not (tmp_path / "owned").exists()
    assert json.loads((out / "run.json").read_text())["status"] != "running"


def test_a_damaged_log_does_not_leave_it_running(
    tmp_path: Path, accepted: tuple[Path, dict[str, Any]], sample_scene: Path
) -> None:
    shutil.copytree(accepted[0], tmp_path / "run")
    (tmp_path / "run" / "run.json").write_text(json.dumps({**accepted[1], "status": "interrupted"}))
    (tmp_path / "run" / "events.jsonl").write_text("nonsense\nmore\n")
    done = grs("run", str(sample_scene), "--out", "run", "--resume", folder=tmp_path)
    assert done.returncode == 2
    assert "events.jsonl line 1" in done.stderr
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "failed"


def _text(file: Path) -> str:
    return file.read_text(errors="replace") if file.is_file() else ""


def test_another_provider_carries_a_whole_run(tmp_path: Path, small_scene: Path, scripted_server: Any) -> None:
    done = grs("run", str(small_scene), "--out", "run", "--json", *settings(scripted_server), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["counts"]["model_calls"] == len(scripted_server.roles)
    assert record["cost"] == pytest.approx(0.25 * len(scripted_server.roles))
    assert {"describe", "match", "task", "simulation", "tests"} <= set(scripted_server.roles)
    for role in ("describe", "match", "task", "simulation"):
        assert scripted_server.images[role] > 0
    assert scripted_server.images["tests"] == 0
    replies = [event for event in read_events(tmp_path / "run" / "events.jsonl") if isinstance(event, Reply)]
    assert {(reply.cached_tokens, reply.cost) for reply in replies} == {(4, 0.25)}


def settings(server: Any) -> list[str]:
    """Options that make the scripted server every role's model."""
    return ["--set", "models.default=openai:any", "--set", f"models.base_url={server.url}"]


def test_an_unusable_reply_is_asked_for_again_and_a_broken_program_is_routed_to_the_code_fixer(
    tmp_path: Path, known_scene: Path, scripted_server: Any
) -> None:
    scripted_server.spoilt["task"] = ["I had rather not.", '```json\n{"task-name": "t"}\n```']
    scripted_server.spoilt["simulation"] = ["```python\nimport numpy as np\n\nraise RuntimeError('no task')\n```"]
    done = grs("run", str(known_scene), "--out", "run", "--json", *settings(scripted_server), folder=tmp_path)
    record = json.loads(done.stdout)
    assert record["status"] == "accepted", record["reason"]
    assert scripted_server.roles.count("task") == 3
    assert record["counts"]["code_fixes"] >= 1
    assert "raise RuntimeError" in (tmp_path / "run" / "history" / "simulation_002.diff").read_text()
    assert scripted_server.images["fix_code"] > 0


def test_broken_tests_are_routed_to_the_test_fixer(tmp_path: Path, known_scene: Path, scripted_server: Any) -> None:
    broken = (
        "```python\nimport unittest\n\nclass TestIt(unittest.TestCase):\n    def test_a(self):\n        nowhere()\n```"
    )
    scripted_server.spoilt["tests"] = [broken]
    done = grs("run", str(known_scene), "--out", "run", "--json", *settings(scripted_server), folder=tmp_path)
    record = json.loads(done.stdout)
    assert record["status"] == "accepted", record["reason"]
    assert (record["counts"]["code_fixes"], record["counts"]["test_fixes"]) == (0, 1)
    assert scripted_server.images.get("fix_tests", 0) == 0


def test_a_model_that_never_answers_usably_is_an_outcome(
    tmp_path: Path, known_scene: Path, scripted_server: Any
) -> None:
    scripted_server.spoilt["simulation"] = ["No."] * 3
    done = grs("run", str(known_scene), "--out", "run", "--json", *settings(scripted_server), folder=tmp_path)
    record = json.loads(done.stdout)
    assert (done.returncode, record["status"]) == (1, "rejected")
    assert "simulation model gave no usable reply in 3 tries" in record["reason"]


def test_fixes_run_out(tmp_path: Path, known_scene: Path, scripted_server: Any) -> None:
    hopeless = "```python\nraise RuntimeError('hopeless')\n```"
    scripted_server.spoilt.update({"simulation": [hopeless], "fix_code": [hopeless] * 9})
    options = [*settings(scripted_server), "--set", "max_fixes=2"]
    done = grs("run", str(known_scene), "--out", "run", "--json", *options, folder=tmp_path)
    record = json.loads(done.stdout)
    assert (done.returncode, record["status"]) == (1, "rejected")
    assert "2 of 2 fixes used" in record["reason"]
    assert record["counts"]["code_fixes"] + record["counts"]["test_fixes"] == 2


@pytest.mark.parametrize("graph", slow_where({"no_fix", "llm_only"}.__contains__, ("no_router", "no_fix", "llm_only")))
def test_the_ablations_come_to_a_verdict(tmp_path: Path, known_scene: Path, graph: str) -> None:
    done = grs("run", str(known_scene), "--out", "run", "--json", "--set", f"graph={graph}", folder=tmp_path)
    record = json.loads(done.stdout)
    assert record["status"] in ("accepted", "rejected")
    assert len(record["rewards"]) == 3
    prompts = [event for event in read_events(tmp_path / "run" / "events.jsonl") if event.kind == "prompt"]
    assert ("tests" in {prompt.role for prompt in prompts}) == (graph == "no_router")
    shown = {prompt.role for prompt in prompts if prompt.images}
    assert ("simulation" in shown) == (graph != "llm_only")


@SLOW
def test_a_real_scene_comes_to_a_verdict(tmp_path: Path, real_scenes: Path) -> None:
    done = grs("run", str(real_scenes / "osd_test45"), "--out", "run", "--json", folder=tmp_path)
    assert done.returncode in (0, 1), done.stderr
    assert json.loads(done.stdout)["counts"]["objects"] >= 2


@pytest.mark.parametrize("word", ["a b", "$HOME", "it's", ";x"])
def test_printed_commands_name_folders_as_a_shell_takes_them(
    accepted: tuple[Path, dict[str, Any]], sample_scene: Path, tmp_path: Path, word: str
) -> None:
    run, out = shutil.copytree(accepted[0], tmp_path / word), tmp_path / f"{word} out"
    summary = grs("run", str(sample_scene), "--out", str(run), "--resume", folder=tmp_path).stdout
    replay = summary.partition("grs replay ")[2].partition("   opens")[0]
    assert shlex.split(replay) == [str(run)]
    exported = grs("export", str(run), "--out", str(out), folder=tmp_path).stdout
    [command] = [line.removeprefix("open it: ") for line in exported.splitlines() if line.startswith("open it: ")]
    assert shlex.split(command) == ["python", "-m", "mujoco.viewer", f"--mjcf={out / 'scene.xml'}"]
