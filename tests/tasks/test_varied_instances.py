"""More instances of a task: made once, checked by the expert, gone on with after an interruption."""

import json
from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.sim import hash_instance, instantiate
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.task_folder import open_task_folder
from grs_agents.tasks.varied_instances import Robot, VariationManifest, make_varied_instances
from tests.cli.command import grs
from tests.gantry import GANTRY
from tests.sim.sim_scenes import Scripted, at, pose_goal

VARIATION = Variation(jitter=0.02)


def two_blocks(task, env) -> None:
    env.add_object("block/blue_block.urdf", at(0.4, 0.1, 0.02))
    pose_goal(task, env.add_object("block/red_block.urdf", at(0.5, -0.1, 0.02)), at(0.5, 0.2, 0.02))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    for seed in (3, 4):
        instance = instantiate(Scripted(two_blocks), seed)
        write_json(folder / "instances" / f"seed_{seed}.json", instance.model_dump(mode="json"))
    return folder


def test_instances_are_a_folder_like_a_runs_with_a_manifest(run: Path, tmp_path: Path) -> None:
    made = make_varied_instances(run, range(4), VARIATION, tmp_path / "out", workers=1)
    folder = open_task_folder(tmp_path / "out")
    assert folder.seeds == (0, 1, 2, 3)
    assert [(one.seed, one.base, one.strict) for one in made.instances] == [(0, 3, 1), (1, 4, 1), (2, 3, 1), (3, 4, 1)]
    for one in made.instances:
        instance = folder.read_instance(one.seed)
        assert instance.seed == one.seed
        assert hash_instance(instance) == one.hash
    assert len({one.hash for one in made.instances}) == 4
    assert made == VariationManifest.model_validate_json((tmp_path / "out" / "manifest.json").read_bytes())


def test_what_is_there_is_kept_and_the_rest_is_made(run: Path, tmp_path: Path) -> None:
    out, seen = tmp_path / "out", list[int]()
    make_varied_instances(run, range(2), VARIATION, out, workers=1)
    first = (out / "instances" / "seed_0.json").stat().st_mtime_ns
    made = make_varied_instances(run, range(3), VARIATION, out, 1, lambda part: seen.append(len(part.seeds)))
    assert seen == [2, 3]
    assert made.seeds == {0, 1, 2}
    assert (out / "instances" / "seed_0.json").stat().st_mtime_ns == first


def test_a_folder_of_something_else_is_refused(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    make_varied_instances(run, range(1), VARIATION, out, workers=1)
    with pytest.raises(InputError, match="another variation"):
        make_varied_instances(run, range(1), Variation(jitter=0.01), out, workers=1)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="holds no varied instances"):
        make_varied_instances(run, range(1), VARIATION, tmp_path / "mine", workers=1)


def test_a_robot_is_the_same_by_any_path_to_its_file(run: Path, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "arm.xml").write_text(GANTRY)
    robots = [Robot(robot=path, hand="suction") for path in ("arm.xml", str(tmp_path / "run" / ".." / "arm.xml"))]
    monkeypatch.chdir(tmp_path)
    first, again = (
        make_varied_instances(run, range(1), VARIATION, tmp_path / "out", workers=1, robot=robot) for robot in robots
    )
    assert again == first and len(first.instances) == 1
    other = robots[0].model_copy(update={"robot": "ur5e"})
    with pytest.raises(InputError, match="for another robot"):
        make_varied_instances(run, range(1), VARIATION, tmp_path / "out", workers=1, robot=other)


def test_what_the_expert_does_not_solve_is_left_out_and_listed(run: Path, tmp_path: Path) -> None:
    def in_the_air(task, env) -> None:
        pose_goal(task, env.add_object("block/red_block.urdf", at(0.5, -0.1, 0.02)), at(0.5, 0.2, 0.12))

    other = tmp_path / "hard"
    instance = instantiate(Scripted(in_the_air), 0)
    write_json(other / "instances" / "seed_0.json", instance.model_dump(mode="json"))
    made = make_varied_instances(other, range(1), VARIATION, tmp_path / "out", workers=1)
    assert made.instances == ()
    assert "its target" in made.left_out[0].detail
    assert not (tmp_path / "out" / "instances").exists()


def test_the_verbs_print_what_they_made(run: Path) -> None:
    options = ("--jitter", "0.02", "--yaw", "30", "--light", "--workers", "1")
    done = grs("instances", str(run), "--seeds", "0:2", *options, "--json", folder=run.parent)
    assert done.returncode == 0, done.stderr
    made = json.loads(done.stdout)
    assert [one["seed"] for one in made["instances"]] == [0, 1]
    assert Path(made["folder"]) == run.parent / "run-instances"
    few = ("--episodes", "1", "--demonstrations", "1", "--trials", "1", "--workers", "1")
    done = grs("grade", str(run), *few, "--json", folder=run.parent)
    assert done.returncode == 0, done.stderr
    assert 0 < json.loads(done.stdout)["difficulty"] < 1


def test_a_table_tells_which_robots_solve_the_task(run: Path, tmp_path: Path) -> None:
    def wide_box(task, env) -> None:
        box = task.fill_template("box/box-template.urdf", {"DIM": (0.12, 0.12, 0.05)})
        pose_goal(task, env.add_object(box, at(0.5, -0.1, 0.025)), at(0.5, 0.2, 0.025))

    wide = tmp_path / "wide"
    write_json(wide / "instances" / "seed_0.json", instantiate(Scripted(wide_box), 0).model_dump(mode="json"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "arm.xml").write_text(GANTRY)
    robots = ("--robot", "ur5e", "--robot", "mine/arm.xml", "--hand", "suction", "--hand", "franka_hand")
    done = grs("instances", str(wide), "--seeds", "0:1", *robots, "--workers", "1", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = {tuple(line.split()[:5]) for line in done.stdout.splitlines()[1:] if " of 1" in line}
    assert lines == {
        ("ur5e", "suction", "1", "of", "1"),
        ("ur5e", "franka_hand", "0", "of", "1"),
        ("arm.xml", "suction", "1", "of", "1"),
        ("arm.xml", "franka_hand", "0", "of", "1"),
    }
    assert "0.120 m across" in " ".join(done.stdout.split())
    made = open_task_folder(tmp_path / "wide-robots" / "arm-suction").read_instance(0)
    assert Path(made.robot) == (tmp_path / "wide-robots" / "arm-suction" / "robot" / "arm.xml").resolve()
    with pytest.raises(InputError, match="for another robot"):
        make_varied_instances(wide, range(1), Variation(), tmp_path / "wide-robots" / "ur5e-suction", workers=1)


def test_a_robot_that_there_is_not_is_refused_before_anything_is_made(run: Path) -> None:
    done = grs("instances", str(run), "--seeds", "0:1", "--robot", "ur5e", "--robot", "ur99", folder=run.parent)
    assert done.returncode == 2
    assert "unknown robot 'ur99'" in " ".join(done.stderr.split())
    assert not (run.parent / "run-robots").exists()


def test_robots_whose_folders_would_have_the_same_name_are_refused(run: Path, tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "arm.xml").write_text(GANTRY)
    done = grs(
        *("instances", str(run), "--seeds", "0:1", "--robot", "first/arm.xml", "--robot", "second/arm.xml"),
        *("--out", str(tmp_path / "robots")),
        folder=tmp_path,
    )
    assert done.returncode == 2
    assert "first/arm.xml and second/arm.xml have the same name" in " ".join(done.stderr.split())
    assert not (tmp_path / "robots").exists()


@pytest.mark.parametrize("text", ["5:5", "7:3", "-1:4", "0:1000000", "a:b", "0:99999999999"])
def test_seeds_that_are_no_range_are_refused(run: Path, text: str) -> None:
    done = grs("instances", str(run), f"--seeds={text}", folder=run.parent)
    assert done.returncode == 2
    assert "no range of seeds" in done.stderr
