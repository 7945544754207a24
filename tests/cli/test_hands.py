"""Runs of robots with fingers, from the command line to the verdict."""

import json
from pathlib import Path

import pytest

from tests.cli.command import grs


def test_fingers_make_an_accepted_run_that_verifies(small_scene: Path, tmp_path: Path) -> None:
    done = grs(
        "run", str(small_scene), "--robot", "panda", "--hand", "franka_hand", "--set", "audit.seeds=1",
        "--out", "run", "--json", folder=tmp_path,
    )  # fmt: skip
    record = json.loads(done.stdout)
    assert (done.returncode, record["status"]) == (0, "accepted"), record["reason"]
    instance = json.loads((tmp_path / "run" / "instances" / "seed_0.json").read_text())
    assert (instance["robot"], instance["hand"]) == ("panda", "franka_hand")
    assert record["config"]["hand"] == "franka_hand"
    assert grs("verify", "run", folder=tmp_path).returncode == 0


def test_a_scene_that_was_tried_with_a_cup_is_not_one_for_fingers(known_scene: Path, tmp_path: Path) -> None:
    done = grs("run", str(known_scene), "--hand", "robotiq_2f85", "--out", "run", folder=tmp_path)
    assert done.returncode == 2
    assert "was made for hand=suction, not robotiq_2f85" in " ".join(done.stderr.split())


@pytest.mark.parametrize(("hand", "says"), [("three_fingers", "there is no hand"), ("own", "has no hand of its own")])
def test_hands_that_there_are_not_are_refused(hand: str, says: str, tmp_path: Path) -> None:
    done = grs("run", "groceries", "--hand", hand, folder=tmp_path)
    assert done.returncode == 2
    assert says in " ".join(done.stderr.split())
