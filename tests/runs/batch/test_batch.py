"""``grs batch``: killed, gone on with, listed, refused."""

import csv
import html
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.runs.batch.batch import summarize_rows
from grs_agents.runs.batch.jobs import run_jobs
from grs_agents.runs.batch.results import BatchResults, read_results, render_page, write_results
from grs_agents.runs.batch.row import BatchRow
from grs_agents.runs.batch.run_process import RunJob
from grs_agents.runs.record import RunRecord
from tests.cli.command import grs
from tests.slow import SLOW


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory, small_scene: Path) -> Path:
    """A batch of a bad scene and a good one, killed in the middle of the good one's run, then gone on with."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "scenes" / "bad").mkdir(parents=True)
    (folder / "scenes" / "bad" / "camera.json").write_text("{}")
    shutil.copytree(small_scene, folder / "scenes" / "good")
    order = ["batch", "scenes", "--out", "out", "--json"]
    command = [sys.executable, "-m", "grs_agents", *order]
    run = folder / "out" / "good-0"
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: '"kind":"node_ended"' in read_if_any(run / "events.jsonl"))
        process.kill()
    wait_until(lambda: '"status": "interrupted"' in read_if_any(run / "run.json"))  # it does not outlive its batch
    done = grs(*order, folder=folder)
    assert done.returncode == 1, done.stderr  # the bad scene has no verdict
    assert json.loads(done.stdout) == json.loads((folder / "out" / "results.json").read_text())
    return folder


def read_if_any(file: Path) -> str:
    """What is in a file that is being made."""
    return file.read_text() if file.is_file() else ""


def wait_until(holds: Callable[[], bool]) -> None:
    """Wait for another process; a minute is more than any machine needs."""
    end = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


@SLOW
def test_a_killed_batch_goes_on_where_it_was(batch: Path) -> None:
    bad, good = read_results(batch / "out").rows
    assert (bad.run, bad.status, good.run, good.status) == ("bad-0", "failed", "good-0", "accepted")
    assert "rgb.png" in bad.reason and not bad.reason.startswith("grs:")
    assert good.reward is not None and good.reward > 0.99
    assert good.goals and good.task and good.family == good.task.split("-")[0]
    record = json.loads((batch / "out" / "good-0" / "run.json").read_text())
    assert record["attempts"] == 2  # the run went on, too


def test_an_ended_run_is_not_made_again(batch: Path) -> None:
    file = batch / "out" / "good-0" / "events.jsonl"
    before = (read_results(batch / "out"), file.stat().st_mtime_ns)
    done = grs("batch", "scenes/good", "scenes/bad", "--out", "out", folder=batch)
    assert "good-0" in done.stdout and "1 of 2 accepted, 1 different tasks" in done.stdout
    after = read_results(batch / "out")
    timeless = [
        {row.run: row.model_copy(update={"seconds": 0}) for row in rows} for rows in (after.rows, before[0].rows)
    ]
    assert timeless[0] == timeless[1]  # the bad scene is tried again, and may take a millisecond more
    assert file.stat().st_mtime_ns == before[1]


def test_the_files_of_a_batch_say_the_same(batch: Path) -> None:
    rows = read_results(batch / "out").rows
    with (batch / "out" / "results.csv").open(newline="") as file:
        table = {row["run"]: row for row in csv.DictReader(file)}
    assert {name: row["status"] for name, row in table.items()} == {row.run: row.status for row in rows}
    page = (batch / "out" / "index.html").read_text()
    assert 'src="good-0/scene/rgb.png"' in page and "<script" not in page
    assert all(row.reason in html.unescape(page) for row in rows)


def test_foreign_text_on_the_page_is_escaped(tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>\"'\x1b[2J"
    texts = dict.fromkeys(("run", "scene", "status", "reason", "task", "description", "repeats"), hostile)
    summary = {"accepted": 0, "runs": 1, "different_tasks": 0, "families": {hostile: 1}, "seconds": 1.0, "cost": 0.0}
    results = BatchResults.model_validate({"summary": summary, "rows": [{**texts, "seed": 0}]})
    page = render_page(tmp_path / "<b>", results)
    assert "<script" not in page and "<b>" not in page and "\x1b" not in page
    assert html.unescape(page).count(hostile.replace("\x1b", "\\x1b")) == 8


def test_parquet_holds_the_rows(batch: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = parquet.read_table(batch / "out" / "results.parquet").to_pylist()
    results = BatchResults.model_validate({"summary": {}, "rows": rows})
    assert results.rows == read_results(batch / "out").rows


def test_runs_are_listed_by_a_condition(batch: Path) -> None:
    done = grs("batch", "--out", "out", "--where", 'status == "accepted" and objects > 1', "--json", folder=batch)
    assert [row["run"] for row in json.loads(done.stdout)["rows"]] == ["good-0"], done.stderr
    done = grs("batch", "--out", "out", "--where", "statsu == 1", folder=batch)
    assert done.returncode == 2 and "status" in done.stderr


def test_runs_of_two_configurations_are_not_mixed(batch: Path) -> None:
    done = grs("batch", "scenes", "--out", "out", "--set", "policy=rules", folder=batch)
    assert done.returncode == 2 and "another config" in done.stderr


def test_a_folder_without_a_batch_is_refused(tmp_path: Path) -> None:
    done = grs("batch", "--out", str(tmp_path), folder=tmp_path)
    assert done.returncode == 2 and "holds no batch" in done.stderr
    (tmp_path / "results.json").write_text('{"rows": 3}')
    done = grs("batch", "--out", str(tmp_path), folder=tmp_path)
    assert done.returncode == 2 and "results.json" in done.stderr


def ended_batch(folder: Path) -> Path:
    """A batch of a run that seems to have ended, as a stranger may send it."""
    run = folder / "out" / "photo-0"
    run.mkdir(parents=True)
    record = RunRecord(
        id="photo-0",
        status="accepted",
        exit_status=0,
        command="run",
        source=str(folder / "photo"),
        graph="grs",
        config=RecordedConfig.of(Config()),
        versions={},
        seeds=(0,),
        rewards=(1.0,),
    )
    record.write(run)
    return run


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("task.json", "{", "task.json"),
        ("task.json", '{"task-name": "\\ud800"}', "task.json"),
        ("instances/seed_0.json", '{"seed": 1e999}', "task is missing"),
    ],
)
def test_a_run_with_a_damaged_file_is_one_failed_row(
    tmp_path: Path, small_scene: Path, name: str, text: str, word: str
) -> None:
    shutil.copytree(small_scene, tmp_path / "photo")
    run = ended_batch(tmp_path)
    (run / name).parent.mkdir(exist_ok=True)
    (run / name).write_text(text)
    done = grs("batch", "photo", "--out", "out", "--json", folder=tmp_path)
    assert done.returncode == 1, done.stderr
    (row,) = json.loads(done.stdout)["rows"]
    assert row["status"] == "failed" and "photo-0 is damaged: " in row["reason"] and word in row["reason"]


@pytest.mark.parametrize(
    "field", [{"rewards": [1e308, 1e308]}, {"counts": {"code_fixes": 5 * 10**19}}, {"seconds": {"total": 1e308}}]
)
def test_a_record_with_impossible_numbers_is_no_record(
    tmp_path: Path, small_scene: Path, field: dict[str, Any]
) -> None:
    shutil.copytree(small_scene, tmp_path / "photo")
    run = ended_batch(tmp_path)
    record = json.loads((run / "run.json").read_text()) | field
    (run / "run.json").write_text(json.dumps(record))
    done = grs("batch", "photo", "--out", "out", "--json", folder=tmp_path)
    assert done.returncode == 1, done.stderr
    (row,) = json.loads(done.stdout)["rows"]
    assert row["status"] == "failed" and "run.json is not a run record" in grs("show", str(run), folder=tmp_path).stderr


def test_the_summary_of_a_foreign_batch_is_made_of_its_rows(tmp_path: Path) -> None:
    row = BatchRow(run="a-0", scene="a", seed=0, status="accepted", reason="", task="pack-a", family="pack")
    (tmp_path / "results.json").write_text(json.dumps({"summary": {"runs": "many"}, "rows": [row.model_dump()]}))
    done = grs("batch", "--out", ".", folder=tmp_path)
    assert done.returncode == 0 and "1 of 1 accepted, 1 different tasks (pack 1)" in done.stdout, done.stderr


@pytest.mark.parametrize("field", [{"reward": 1e308}, {"code_fixes": 10**400}, {"cost": float("nan")}, {"seed": -1}])
def test_rows_of_a_foreign_batch_are_bounded(tmp_path: Path, field: dict[str, Any]) -> None:
    row = BatchRow(run="a-0", scene="a", seed=0, status="accepted", reason="").model_dump() | field
    (tmp_path / "results.json").write_text(json.dumps({"summary": {}, "rows": [row]}))
    done = grs("batch", "--out", ".", folder=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "results.json" in done.stderr, done.stderr


def test_no_cell_of_the_table_is_a_formula(tmp_path: Path) -> None:
    texts = ("=1+1", "+1 cup", "-2+3", "@sum", "\ttab", "\rreturn", "as it is", "-0.5", "")
    rows = tuple(
        BatchRow(run=f"run-{number}", scene=text, seed=0, status="accepted", reason=text, reward=-1.5)
        for number, text in enumerate(texts)
    )
    write_results(tmp_path, summarize_rows(rows))
    with (tmp_path / "results.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["reason"] for row in table] == [*(f"'{text}" for text in texts[:6]), *texts[6:]]
    assert [row["scene"] for row in table] == [row["reason"] for row in table]
    assert {row["reward"] for row in table} == {"-1.5"}
    assert [row["reason"] for row in json.loads((tmp_path / "results.json").read_text())["rows"]] == list(texts)


def test_a_run_that_takes_too_long_is_killed(tmp_path: Path, small_scene: Path) -> None:
    (end,) = run_jobs([RunJob("slow", str(small_scene), 0, tmp_path / "slow")], timeout=0.5)
    assert end.exit_status is None and "killed after" in end.error


WAITING = """
import os, pathlib, signal, sys, time
from langgraph.graph import END, START, StateGraph
from grs_agents.graph import Services
from grs_agents.graph.state import RunState

waits = any(name.endswith("second") for name in sys.argv) and not pathlib.Path(__file__).with_suffix(".pid").exists()

def work(state: RunState):
    if waits:
        pathlib.Path(__file__).with_suffix(".pid").write_text(str(os.getpid()))
        while True:
            time.sleep(60)
    return {"status": "accepted", "reason": "done"}

def build():
    if waits and STUBBORN:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("work", work)
    graph.add_edge(START, "work")
    graph.add_edge("work", END)
    return graph
"""
"""A graph whose run of the second scene waits for ever when it is made for the first time."""


@pytest.mark.parametrize("stubborn", [False, pytest.param(True, marks=SLOW)])
def test_a_batch_that_is_asked_to_end_ends_its_runs_and_goes_on(
    tmp_path: Path, small_scene: Path, stubborn: bool
) -> None:
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "waiting.py").write_text(WAITING.replace("STUBBORN", str(stubborn)))
    for name in ("first", "second"):
        shutil.copytree(small_scene, tmp_path / name)
    order = ["--content", ".", "batch", "first", "second", "--set", "graph=waiting", "--workers", "1"]
    order += ["--timeout", "3600", "--out", "out", "--json"]
    number = tmp_path / "graphs" / "waiting.pid"
    with subprocess.Popen(
        [sys.executable, "-m", "grs_agents", *order], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as driver:
        assert driver.stderr is not None
        wait_until(lambda: read_if_any(number) != "")
        driver.terminate()
        assert driver.wait(60) == 130
        assert b"the same command goes on" in driver.stderr.read()
    with pytest.raises(ProcessLookupError):
        os.kill(int(number.read_text()), 0)
    assert [(row.run, row.status) for row in read_results(tmp_path / "out").rows] == [("first-0", "accepted")]
    record = tmp_path / "out" / "second-0" / "run.json"
    assert json.loads(record.read_text())["status"] == ("running" if stubborn else "interrupted")
    done = grs(*order, folder=tmp_path)
    rows = json.loads(done.stdout)["rows"]
    assert [(row["run"], row["status"]) for row in rows] == [("first-0", "accepted"), ("second-0", "accepted")]
    assert json.loads(record.read_text())["attempts"] == 2


def graph_that_tells(reason: str) -> str:
    """Source of a graph of one node, which gives the value of an expression as the reason of its run."""
    return f"""{WAITING.split("waits =", maxsplit=1)[0]}
def work(state: RunState):
    return {{"status": "accepted", "reason": {reason}}}

def build():
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("work", work)
    graph.add_edge(START, "work")
    graph.add_edge("work", END)
    return graph
"""


FORKED = graph_that_tells('f"{os.getpgrp() == os.getpid()} {os.get_inheritable(0)} {os.getppid()}"')
"""A graph whose run tells the number of its parent, whether it leads a process group and lends its standard input."""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no run is forked")
def test_the_runs_of_a_batch_are_forks_of_one_process(tmp_path: Path, small_scene: Path) -> None:
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "forked.py").write_text(FORKED)
    for name in ("first", "second"):
        shutil.copytree(small_scene, tmp_path / name)
    order = ("batch", "first", "second", "--set", "graph=forked", "--out", "out", "--json")
    done = grs("--content", ".", *order, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    reasons = {row["reason"] for row in json.loads(done.stdout)["rows"]}
    assert len(reasons) == 1 and reasons.pop().startswith("True True ")


TELLING = graph_that_tells('" ".join(sorted(name for name in os.environ if "GRS" in name or "KEY" in name))')
"""A graph whose run tells the names of variables that it finds in its environment."""


def test_a_cluster_gets_the_variables_that_runs_need(
    tmp_path: Path, small_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cluster stands before the variables are set, so that it can have them from the batch alone."""
    pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    pytest.importorskip("langchain_openai")
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "telling.py").write_text(TELLING)
    cluster = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        for name in ("OPENAI_API_KEY", "MY_KEY", "GRS_SEED", "GITHUB_KEY", "ANTHROPIC_API_KEY"):
            monkeypatch.setenv(name, "3")
        models = ["models.default=openai:any", "models.judge.model=openai:any", "models.judge.key_variable=MY_KEY"]
        settings = [part for setting in (*models, "graph=telling") for part in ("--set", setting)]
        order = ["--content", ".", "batch", str(small_scene), "--engine", "ray", "--address", cluster.address]
        done = grs(*order, *settings, "--out", "out", "--json", folder=tmp_path)
    finally:
        cluster.shutdown()
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)["rows"]
    assert set(row["reason"].split()) & {"OPENAI_API_KEY", "MY_KEY", "GRS_SEED", "GITHUB_KEY", "ANTHROPIC_API_KEY"} == {
        "OPENAI_API_KEY",
        "MY_KEY",
        "GRS_SEED",
    }


def test_a_lost_worker_of_a_cluster_costs_its_own_run(tmp_path: Path, small_scene: Path) -> None:
    """Two nodes on this machine; the process of one run is killed with its worker, and that run is made again."""
    ray = pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    cluster = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    cluster.add_node(num_cpus=1)
    jobs = [RunJob(name, str(small_scene), 0, tmp_path / name) for name in ("one", "two")]
    killed: list[int] = []

    try:
        ray.init(address=cluster.address, log_to_driver=False)

        def kill_worker() -> None:
            wait_until((tmp_path / "one" / "events.jsonl").is_file)
            for process in Path("/proc").glob("[0-9]*"):
                with suppress(OSError):  # it has ended
                    worker = process.parent / (process / "stat").read_text().rpartition(")")[2].split()[1]
                    warm = [b"warm_parent" in (one / "cmdline").read_bytes() for one in (process, worker)]
                    if warm == [True, False] and (process / "fd" / "2").readlink() == tmp_path / "one.log":
                        killed.append(int(worker.name))
                        os.kill(int(worker.name), 9)

        killer = threading.Thread(target=kill_worker)
        killer.start()
        ends = run_jobs(jobs, engine="ray", timeout=120)
        killer.join()
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert killed and [end.job.name for end in ends] == ["one", "two"]
    attempts = [json.loads((tmp_path / name / "run.json").read_text())["attempts"] for name in ("one", "two")]
    assert attempts == [2, 1]


def test_the_key_of_the_judge_goes_along_to_a_cluster(
    small_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from grs_agents.runs.batch.batch import BatchOrder, run_batch

    variables: list[str] = []

    class Shipped(Exception):
        """The runs would begin."""

    def ship(jobs: Sequence[RunJob], *args: object, **named: Any) -> None:
        variables.extend(named["variables"])
        raise Shipped

    monkeypatch.setattr("grs_agents.runs.batch.batch.run_jobs", ship)
    with pytest.raises(Shipped):
        run_batch(
            BatchOrder((str(small_scene),), tmp_path / "out", settings=("audit.judge=anthropic:x",), engine="ray")
        )
    assert "ANTHROPIC_API_KEY" in variables
