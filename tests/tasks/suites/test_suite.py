"""Suites: their tasks, words and tags, and the hash of every file."""

import json
import random
import shutil
from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.runs.batch.results import BatchResults
from grs_agents.runs.batch.row import BatchRow
from grs_agents.sim import inside, near, stacked
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.suite import find_tags, list_changes_of_suite, make_suite, open_suite_task, read_suite
from tests.cli.command import grs
from tests.tasks.envs.conftest import block_instance
from tests.tasks.suites.conftest import VARIATION


def test_a_suite_lists_tasks_with_words_robot_and_solved_instances(suite_folder: Path) -> None:
    suite = read_suite(suite_folder)
    assert [task.name for task in suite.tasks] == ["put-block-left", "put-block-left-2"]
    first, second = suite.tasks
    assert (first.robot, first.hand, first.moves, first.source) == ("ur5e", "suction", 1, "near")
    assert first.words == {
        "vague": "tidy up",
        "default": "Put the red block to the left.",
        "specific": "the block ends at the left; nothing else moves",
    }
    assert second.words == dict.fromkeys(("default", "specific"), "put the block at the left")
    folder = open_suite_task(suite_folder, first)
    assert len(first.seeds) == 2 and set(first.seeds) <= set(folder.seeds)
    starts = {folder.read_instance(seed).objects[0].pose for seed in first.seeds}
    assert len(starts) == 2


def test_each_of_twenty_changed_bytes_is_found(suite_folder: Path, tmp_path: Path) -> None:
    rng = random.Random(20)
    copy = tmp_path / "copy"
    shutil.copytree(suite_folder, copy)
    assert list_changes_of_suite(copy) == ()
    files = sorted(file for file in copy.rglob("*") if file.is_file())
    for _ in range(20):
        file = rng.choice(files)
        data = file.read_bytes()
        place = rng.randrange(len(data))
        file.write_bytes(data[:place] + bytes([data[place] ^ 1 << rng.randrange(7)]) + data[place + 1 :])
        try:
            assert list_changes_of_suite(copy), (file, place)
        except InputError:  # suite.json itself, of which nothing can be read any more
            assert file.name == "suite.json"
        file.write_bytes(data)


def test_files_that_were_added_or_removed_are_named(suite_folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(suite_folder, copy)
    (copy / "tasks" / "another").mkdir()
    (copy / "tasks" / "put-block-left" / "manifest.json").unlink()
    (copy / "tasks" / "put-block-left-2" / "notes.txt").write_text("x")
    assert list_changes_of_suite(copy) == (
        "tasks/another: it was added",
        "tasks/put-block-left/manifest.json: it is missing",
        "tasks/put-block-left-2/notes.txt: it was added",
    )
    done = grs("verify", str(copy), folder=tmp_path)
    assert done.returncode == 1 and "3 differences" in done.stdout
    assert grs("verify", str(suite_folder), folder=tmp_path).returncode == 0


def test_an_interrupted_suite_goes_on_and_a_finished_suite_is_not_replaced(runs: list[Path], tmp_path: Path) -> None:
    folder = tmp_path / "suite"
    whole = make_suite(folder, runs, "s", 1, VARIATION, workers=1)
    (folder / "suite.json").unlink()
    before = {file: file.stat().st_mtime_ns for file in (folder / "tasks").rglob("seed_*.json")}
    assert make_suite(folder, runs, "s", 1, VARIATION, workers=1) == whole
    assert before == {file: file.stat().st_mtime_ns for file in before}
    with pytest.raises(InputError, match="holds a suite already"):
        make_suite(folder, runs, "s", 1, VARIATION, workers=1)
    with pytest.raises(InputError, match="another variation"):
        (folder / "suite.json").unlink()
        make_suite(folder, runs, "s", 1, Variation(jitter=0.1), workers=1)


@pytest.mark.parametrize(
    ("words", "goals", "tags"),
    [
        ("Put the red block to the left.", (), {"color"}),
        ("Put the milk into the tall box.", (inside(1, 2),), {"size", "in"}),
        ("Put the milk behind the can.", (near(1, 2),), {"kind", "beside", "side"}),
        ("First the can, then the milk.", (stacked([1, 2]),), {"kind", "on", "order", "several moves"}),
    ],
)
def test_tags_follow_from_goals_and_words(words: str, goals: tuple[object, ...], tags: set[str]) -> None:
    instance = block_instance(0)
    assert set(find_tags(instance.model_copy(update={"goals": goals or instance.goals}), words)) == tags


@pytest.mark.parametrize(
    ("words", "stated", "tags"),
    [
        ("Pack both cans into the orange box.", "Put both cans in the orange box.", {"color", "in"}),
        ("Clear the green area.", "Put the milk within the unmarked area in front of the robot.", {"color"}),
        (
            "Build a tower on the mark, in this order from the bottom to the top.",
            "Put the can in the middle of the mark, then stack the milk on the can. The mark is not in the photo.",
            {"kind", "on", "order"},
        ),
        (
            "Line up the cans from the shortest to the tallest.",
            "Line up the can and the milk from left to right on the mark.",
            {"size", "on", "line", "order"},
        ),
        ("Line up the cans.", "Line up the can and the milk in any order.", {"kind", "line"}),
    ],
)
def test_tags_of_goals_by_pose_and_zone_follow_from_their_sentence(words: str, stated: str, tags: set[str]) -> None:
    assert set(find_tags(block_instance(0).model_copy(update={"instruction": stated}), words)) == tags


def test_a_batch_stands_for_its_accepted_runs_of_different_tasks(runs: list[Path], tmp_path: Path) -> None:
    rows = [
        BatchRow(run="near", scene="s", seed=0, status="accepted", reason=""),
        BatchRow(run="far", scene="s", seed=1, status="accepted", reason="", repeats="near"),
        BatchRow(run="none", scene="s", seed=2, status="rejected", reason="no"),
    ]
    shutil.copytree(runs[0], tmp_path / "batch" / "near")
    write_json(tmp_path / "batch" / "results.json", BatchResults(summary={}, rows=tuple(rows)))
    done = grs("suite", "made", "batch", "--instances", "1", "--workers", "1", "--json", folder=tmp_path)
    assert [task["source"] for task in json.loads(done.stdout)["tasks"]] == ["near"]
    outside = rows[0].model_copy(update={"run": "../batch/near"})
    write_json(tmp_path / "batch" / "results.json", BatchResults(summary={}, rows=(outside,)))
    assert "names the run '../batch/near'" in grs("suite", "other", "batch", folder=tmp_path).stderr
